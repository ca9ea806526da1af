import importlib.util
from pathlib import Path

import pytest

EXAMPLES = Path(__file__).parents[1] / "examples"


@pytest.mark.slow
def test_pipe_rack_leak_finds_the_leak(tmp_path: Path) -> None:
    spec = importlib.util.spec_from_file_location("example", EXAMPLES / "pipe_rack_leak.py")
    assert spec is not None
    assert spec.loader is not None
    example = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(example)
    evaluation = example.main(tmp_path, frames=40)
    assert len(evaluation.plumes) == 1
    assert evaluation.plumes[0].error_percent < 5
    assert not evaluation.false_plumes
