"""Which detector a name means, and which files it reads."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from detect.registered.evidence_network import SCORES
from detect.registered.features import FEATURES
from detect.registry import KINDS, DetectorChoice, make_detector
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
    kind = replace(KINDS["registered"], installed_weights=tmp_path / "installed.onnx")
    monkeypatch.setitem(KINDS, "registered", kind)
    assert make_detector("registered").name == "registered-plain"
    assert DetectorChoice.parse("registered").weight_files(None) == []
    installed = network(tmp_path / "installed.onnx")
    assert make_detector("registered").name == "registered"
    assert make_detector("registered-plain").name == "registered-plain"
    assert DetectorChoice.parse("registered-plain").weight_files(None) == []
    assert DetectorChoice.parse("registered").weight_files(None) == [installed]
    mine = network(tmp_path / "mine.onnx")
    assert DetectorChoice.parse("registered").weight_files(mine) == [mine]
    both = DetectorChoice.parse("registered+dybs")
    assert both.name == "registered+dybs"
    assert both.weight_files(mine) == [installed, mine]


def test_the_first_detector_of_two_decides_what_a_plume_must_show() -> None:
    assert DetectorChoice.parse("registered+dybs").clutter_nats == 5
    for name in ("dybs", "bos", "registered-plain+dybs", "dybs+registered", "another"):
        choice = DetectorChoice.parse(name)
        assert choice.name == name
        assert choice.clutter_nats == 0
        assert choice.reliability is None


def test_an_unknown_detector_cannot_be_made() -> None:
    with pytest.raises(BadInputError, match="no detector is called 'another'"):
        make_detector("another")


def test_weights_of_another_network_are_refused_before_anything_is_done(tmp_path: Path) -> None:
    grey = convolution(tmp_path / "grey.onnx", {"logit": np.zeros((1, 1, 1, 1))})
    for detector in ("registered", "auto"):
        config = RunConfig(recording=tmp_path / "none.mp4", detector=detector, weights=grey)
        with pytest.raises(BadInputError, match=r"grey\.onnx: not a"):
            Run(config, tmp_path / "out")
    assert not (tmp_path / "out").exists()
