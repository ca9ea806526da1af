"""Which detector a name means, and which files it reads."""

from pathlib import Path

import numpy as np
import pytest

from detect import registry
from detect.registered.features import FEATURES
from detect.registered.learned import SCORES
from detect.registry import files_of, make_detector
from geometry.errors import BadInputError
from locate.pipeline.config import RunConfig
from locate.pipeline.run import Run
from tests.detect.onnx_files import convolution


def network(path: Path) -> Path:
    """Over registered neighbours; silent everywhere."""
    sizes = {"displacement": 2, "log_variance": 1, "logit": 1}
    kernels = {name: np.zeros((size, len(FEATURES), 1, 1)) for name, size in sizes.items()}
    return convolution(path, kernels, calibration={"scores": list(SCORES), "classes": {}})


def test_registered_is_learned_where_weights_are_installed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(registry, "REGISTERED_WEIGHTS", tmp_path / "installed.onnx")
    assert make_detector("registered").name == "registered-plain"
    assert files_of("registered", None) == []
    installed = network(tmp_path / "installed.onnx")
    assert make_detector("registered").name == "registered"
    assert make_detector("registered-plain").name == "registered-plain"
    assert files_of("registered-plain", None) == []
    assert files_of("registered", None) == [installed]
    mine = network(tmp_path / "mine.onnx")
    assert files_of("registered", mine) == [mine]
    assert files_of("registered+dybs", mine) == [installed, mine]


def test_weights_of_another_network_are_refused_before_anything_is_done(tmp_path: Path) -> None:
    grey = convolution(tmp_path / "grey.onnx", {"logit": np.zeros((1, 1, 1, 1))})
    for detector in ("registered", "auto"):
        config = RunConfig(recording=tmp_path / "none.mp4", detector=detector, weights=grey)
        with pytest.raises(BadInputError, match=r"grey\.onnx: not a"):
            Run(config, tmp_path / "out")
    assert not (tmp_path / "out").exists()
