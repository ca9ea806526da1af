"""The notebook runs from its first cell to its last, and shows what it says."""

import json
from pathlib import Path
from typing import Any

import IPython.display
import pytest

NOTEBOOK = Path(__file__).parents[1] / "examples" / "video_to_plume.ipynb"


def test_the_notebook_goes_from_a_video_to_a_plume(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    shown: list[Any] = []
    monkeypatch.setattr(IPython.display, "display", shown.append)
    monkeypatch.chdir(tmp_path)
    cells = json.loads(NOTEBOOK.read_text())["cells"]
    names: dict[str, Any] = {}
    for cell in cells:
        if cell["cell_type"] == "code":
            exec("".join(cell["source"]), names)
    assert [type(one) for one in shown] == [IPython.display.Image] * 3
    assert len(names["plume_map"].plumes) == 1
    assert "% of the range off" in capsys.readouterr().out
