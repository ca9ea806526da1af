"""`locate clean`: what a finished run can do without, and the locks of the other commands."""

from pathlib import Path

import pytest
from typer.testing import CliRunner

from geometry.errors import BadInputError
from geometry.lock import hold_lock
from locate.commands.app import app
from locate.pipeline.clean import list_dispensable, open_finished, remove_dispensable
from locate.pipeline.run_folder import RunFolder
from locate.pipeline.stage import Stage
from locate.recording.sample import SAMPLE_VIDEO

STAGES = {"frames": "frames/a.png", "poses": "sfm/model", "detections": "detections/a.npz"}
SCENES = Path(__file__).parents[2] / "examples" / "scenes"


def finish(root: Path, made: list[str] | None = None) -> RunFolder:
    """A folder as a run leaves it, its files of 1000 bytes."""
    folder = RunFolder(root)
    with folder.hold():
        folder.save_config({})
        for name, file in {**STAGES, "fusion": "map.json", "report": "report.html"}.items():

            def build(partial: Path, name: str = name, file: str = file) -> str:
                (partial / file).parent.mkdir(exist_ok=True)
                (partial / file).write_bytes(bytes(1000))
                if made is not None:
                    made.append(name)
                return "done"

            folder.complete(Stage(name=name, inputs={}), build)
    return folder


def names_in(root: Path) -> set[str]:
    return {path.name for path in root.iterdir() if not path.name.startswith(".")}


def test_what_can_go_is_listed_and_nothing_is_removed(tmp_path: Path) -> None:
    finish(tmp_path / "run")
    before = names_in(tmp_path / "run")
    said = CliRunner().invoke(app, ["clean", str(tmp_path / "run")])
    assert said.exit_code == 0
    for name in ("frames", "sfm", "detections", "--remove"):
        assert name in said.output
    assert names_in(tmp_path / "run") == before


def test_the_answer_stays_and_the_next_run_makes_the_rest_again(tmp_path: Path) -> None:
    root = tmp_path / "run"
    finish(root)
    left = root / ".partial" / "poses-0"
    left.mkdir()
    (left / "half").write_bytes(bytes(500))
    folder = open_finished(root)
    assert {one.name: one.size for one in list_dispensable(folder)} == {
        "frames": 1000, "sfm": 1000, "detections": 1000, ".partial/poses-0": 500,
    }  # fmt: skip
    said = CliRunner().invoke(app, ["clean", str(root), "--remove"])
    assert said.exit_code == 0
    assert names_in(root) == {"config.yaml", "map.json", "report.html"}
    assert not list_dispensable(open_finished(root))
    made: list[str] = []
    finish(root, made)
    assert made == list(STAGES)


@pytest.mark.parametrize("name", ["nothing", "other"])
def test_what_is_no_finished_run_is_left_alone(tmp_path: Path, name: str) -> None:
    (tmp_path / "other").mkdir()
    (tmp_path / "other" / "frames").mkdir()
    with pytest.raises(BadInputError, match="not the folder of a finished run"):
        open_finished(tmp_path / name)
    assert not (tmp_path / "nothing").exists()
    (tmp_path / "other" / "map.json").write_text("{}")
    with pytest.raises(BadInputError, match="not a run folder"):
        open_finished(tmp_path / "other")
    assert (tmp_path / "other" / "frames").is_dir()


def test_a_folder_that_another_command_works_on_is_not_cleaned(tmp_path: Path) -> None:
    folder = finish(tmp_path / "run")
    with hold_lock(tmp_path / "run"), pytest.raises(BadInputError, match="at work"):
        remove_dispensable(folder)
    assert (tmp_path / "run" / "frames").is_dir()


@pytest.mark.parametrize(
    "arguments",
    [
        ["simulate", str(SCENES / "pipe_rack_leak.yaml")],
        ["train", "judge"],
        ["bos", str(SAMPLE_VIDEO)],
    ],
    ids=lambda arguments: arguments[0],
)
def test_two_commands_on_one_folder(tmp_path: Path, arguments: list[str]) -> None:
    if arguments[0] == "train":
        pytest.importorskip("torch", reason="the extra `train` is not installed")
    with hold_lock(tmp_path):
        said = CliRunner().invoke(app, [*arguments, "-o", str(tmp_path)])
    assert isinstance(said.exception, BadInputError)
    assert "another command is at work" in str(said.exception)
    assert [path.name for path in tmp_path.iterdir()] == [".lock"]
