import importlib.util
from pathlib import Path
from types import ModuleType

import pytest

EXAMPLES = Path(__file__).parents[1] / "examples"


def example(name: str) -> ModuleType:
    spec = importlib.util.spec_from_file_location(name, EXAMPLES / f"{name}.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.mark.slow
def test_pipe_rack_leak_finds_the_leak(tmp_path: Path) -> None:
    evaluation = example("pipe_rack_leak").main(tmp_path, frames=40)
    assert len(evaluation.plumes) == 1
    assert evaluation.plumes[0].error_percent < 5
    assert not evaluation.false_plumes


def test_single_frame_sees_a_plume_before_a_lattice(tmp_path: Path) -> None:
    picture = tmp_path / "picture.png"
    (score,) = example("single_frame").main(picture, [3])
    assert score > 0.95
    assert picture.stat().st_size > 10_000
