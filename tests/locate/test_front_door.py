"""``import locate``: what a program sees, what it costs, and that the examples are true."""

import doctest
import inspect
import json
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import locate
from geometry.errors import BadInputError
from locate.recording.sample import SAMPLE, SAMPLE_VIDEO

NAMES = (
    "Answer",
    "Bearing",
    "LocateError",
    "Locator",
    "Obstacle",
    "Plume",
    "PlumeMap",
    "RunConfig",
    "evaluate",
    "load_map",
    "run",
)
HEAVY = {"numpy", "scipy", "cv2", "pycolmap", "gtsam", "onnxruntime", "open3d", "torch", "pydantic"}
IMPORTED = "import json, sys; import locate; print(json.dumps(sorted(sys.modules)))"


def test_it_offers_these_names() -> None:
    assert tuple(locate.__all__) == NAMES
    assert set(NAMES) <= set(dir(locate))
    for name in NAMES:
        assert getattr(locate, name).__doc__
    with pytest.raises(AttributeError, match="no attribute 'plumes'"):
        _ = locate.plumes


def test_import_brings_no_library() -> None:
    shown = subprocess.run(
        [sys.executable, "-c", IMPORTED], capture_output=True, text=True, check=True
    ).stdout
    assert not HEAVY & set(json.loads(shown))


@pytest.fixture(scope="module")
def finished(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with what the examples speak of: a recording, its scene and a finished run."""
    folder = tmp_path_factory.mktemp("examples")
    shutil.copy(SAMPLE_VIDEO, folder / "video.mkv")
    shutil.copytree(SAMPLE, folder / "scene")
    locate.run(str(folder / "video.mkv"), str(folder / "out"), max_frames=14)
    return folder


@pytest.mark.parametrize("name", NAMES)
def test_the_example_of_a_name_is_true(
    name: str, finished: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(finished)
    documented = getattr(locate, name)
    examples = doctest.DocTestParser().get_examples(inspect.getdoc(documented) or "")
    assert examples or name == "LocateError"
    test = doctest.DocTest(examples, {}, name, None, None, None)
    failures: list[str] = []
    result = doctest.DocTestRunner().run(test, out=failures.append)
    assert not result.failed, "".join(failures)


def test_paths_may_be_text_and_a_map_is_read_from_its_folder(finished: Path) -> None:
    of_folder, of_file = (
        locate.load_map(str(finished / "out")),
        locate.load_map(finished / "out" / "map.json"),
    )
    assert of_folder.to_dict() == of_file.to_dict()


def test_a_setting_that_is_not_known_is_named(finished: Path) -> None:
    with pytest.raises(BadInputError, match="no setting is called focal; did you mean focal_px"):
        locate.run(finished / "video.mkv", finished / "out", focal=3.0)


def test_a_recording_that_is_missing_is_one_error(tmp_path: Path) -> None:
    with pytest.raises(locate.LocateError, match=r"none\.mp4"):
        locate.run(tmp_path / "none.mp4", tmp_path / "out")


def test_all_settings_may_come_at_once(finished: Path) -> None:
    config = locate.RunConfig(recording=finished / "video.mkv", max_frames=14)
    before = (finished / "out" / "map.json").stat().st_mtime_ns
    locate.run(config, finished / "out")
    assert (finished / "out" / "map.json").stat().st_mtime_ns == before
