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
from detect.detection import Detection
from detect.registry import make_detector
from geometry.errors import BadInputError
from geometry.trajectory import Trajectory
from locate.map.plume import PlumeMap
from locate.recording.sample import SAMPLE, SAMPLE_VIDEO
from locate.telemetry import read_telemetry

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


def test_a_run_starts_without_what_few_runs_need() -> None:
    code = "import json, sys, locate.commands.app, locate.pipeline.run as _; "
    code += "print(json.dumps(list(sys.modules)))"
    started = subprocess.run([sys.executable, "-c", code], capture_output=True, check=True)
    assert not {"scipy.stats", "scipy.signal", "detect.synthesis"} & set(json.loads(started.stdout))


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


def test_files_may_be_named_by_text(finished: Path, tmp_path: Path) -> None:
    of_map = PlumeMap.load(str(finished / "out" / "map.json"))
    assert of_map.to_dict() == locate.load_map(finished / "out").to_dict()
    poses = str(tmp_path / "trajectory.json")
    Trajectory.load(str(finished / "out" / "trajectory.json")).save(poses)
    assert len(Trajectory.load(poses)) > 1
    first = next((finished / "out" / "detections").glob("*.npz"))
    kept = str(tmp_path / "kept.npz")
    Detection.load(str(first)).save(kept)
    assert (Detection.load(kept).llr == Detection.load(first).llr).all()
    with pytest.raises(BadInputError, match=r"none\.onnx"):
        make_detector("dybs", weights=str(tmp_path / "none.onnx"))
    with pytest.raises(BadInputError, match="no such file"):
        read_telemetry(str(tmp_path / "none.srt"))


def test_settings_given_beside_all_settings_go_first_and_are_checked(finished: Path) -> None:
    config = locate.RunConfig(recording=finished / "video.mkv", max_frames=14)
    with pytest.raises(BadInputError, match="setting max_frames: Input should be greater"):
        locate.run(config, finished / "out", max_frames=1)


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
