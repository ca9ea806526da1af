"""The command on the bundled sample, as a user types it."""

import json
import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Iterator, Mapping
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from detect.registered import registration
from geometry.errors import BadInputError, RegistrationError, RegistrationFailure
from geometry.georeference import fit
from geometry.sfm import mapping
from geometry.trajectory import Trajectory
from locate.export.report import words
from locate.fusion import limit
from locate.map.plume import PlumeMap
from locate.pipeline.config import RunConfig
from locate.pipeline.fingerprint import source_of
from locate.pipeline.run import Run
from locate.pipeline.run_folder import RunFolder
from locate.pipeline.stamp import Stamp
from locate.recording import KeyFrames, keyframes
from locate.recording.motion import StillnessTest
from locate.recording.sample import SAMPLE, SAMPLE_VIDEO
from locate.recording.writer import LOSSLESS, create_video
from tests.detect.fluctuating import frames
from tests.no_network import SOCKET_CALL, forbid_network

FRAMES = "14"
MID_STAGE = {"poses": "sfm/database.db", "detections": "detections/*.npz"}
STAGES = ("frames", "poses", "place", "detections", "fusion", "report")
KILLED_BEFORE_ITS_RESULT_IS_KEPT = """
import os
import signal
import sys

from locate.cli import main
from locate.pipeline.run_folder import RunFolder

stage = sys.argv.pop(1)
publish = RunFolder._publish


def kill_or_publish(self, partial, fingerprint, spent):
    if spent.name == stage:
        os.kill(os.getpid(), signal.SIGKILL)
    return publish(self, partial, fingerprint, spent)


RunFolder._publish = kill_or_publish
main()
"""


def command(*arguments: object) -> list[str]:
    return [sys.executable, "-m", "locate", *map(str, arguments)]


def locate(*arguments: object) -> subprocess.CompletedProcess[str]:
    """Runs the command, to which the kernel gives no socket to the network."""
    return subprocess.run(
        command(*arguments),
        capture_output=True,
        text=True,
        check=False,
        preexec_fn=forbid_network,
    )


@pytest.fixture(scope="module")
def finished(tmp_path_factory: pytest.TempPathFactory) -> Path:
    output = tmp_path_factory.mktemp("run") / "out"
    result = locate("run", SAMPLE_VIDEO, "-o", output, "--max-frames", FRAMES)
    assert result.returncode == 0, result.stderr
    return output


def test_run_leaves_every_file(finished: Path) -> None:
    names = {path.name for path in finished.iterdir() if not path.name.startswith(".")}
    assert names == {
        "config.yaml", "detections", "evidence.npz", "frames", "log.jsonl", "map.json",
        "overlay.mp4", "placement.json", "plumes.ply", "points.npz", "report.html",
        "scene.ply", "sfm", "trajectory.json",
    }  # fmt: skip
    assert PlumeMap.load(finished / "map.json").units == "scene"
    assert len(Trajectory.load(finished / "trajectory.json")) == int(FRAMES)


@pytest.mark.skipif(SOCKET_CALL is None, reason="the system calls of this processor")
@pytest.mark.parametrize(("family", "code"), [("AF_INET", 1), ("AF_INET6", 1), ("AF_UNIX", 0)])
def test_a_run_does_without_any_socket(finished: Path, family: str, code: int) -> None:
    assert (finished / "map.json").exists()
    asks = f"import socket; socket.socket(socket.{family})"
    done = subprocess.run([sys.executable, "-c", asks], check=False, preexec_fn=forbid_network)
    assert done.returncode == code


def test_log_has_a_line_for_every_stage(finished: Path) -> None:
    lines = [json.loads(line) for line in (finished / "log.jsonl").read_text().splitlines()]
    done = [line["stage"] for line in lines if "cpu_s" in line]
    assert done == list(STAGES)


def test_second_run_skips_everything(finished: Path) -> None:
    before = {path: path.stat().st_mtime_ns for path in (finished / ".stages").iterdir()}
    result = locate("run", SAMPLE_VIDEO, "-o", finished, "--max-frames", FRAMES)
    assert result.returncode == 0
    assert {path: path.stat().st_mtime_ns for path in before} == before
    assert {path.stem for path in before} == set(STAGES)


def stage_fingerprints(finished: Path, monkeypatch: pytest.MonkeyPatch) -> dict[str, str]:
    """Of every stage of the finished run, were it run again; nothing is done."""
    found: dict[str, str] = {}

    def record(folder, stage, _build) -> None:
        found[stage.name] = folder._fingerprint(stage)

    monkeypatch.setattr(RunFolder, "complete", record)
    monkeypatch.setattr(RunFolder, "withdraw_others", lambda _: None)
    Run(RunConfig(recording=SAMPLE_VIDEO, max_frames=int(FRAMES)), finished).run()
    return found


def test_stamps_hold_these_fingerprints(finished: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    stamps = {name: Stamp.load(finished / ".stages" / f"{name}.json") for name in STAGES}
    expected = stage_fingerprints(finished, monkeypatch)
    assert {name: stamp.fingerprint for name, stamp in stamps.items() if stamp} == expected


@pytest.mark.parametrize(
    ("module", "first"),
    [
        (keyframes, "frames"),
        (mapping, "poses"),
        (fit, "place"),
        (registration, "detections"),
        (limit, "fusion"),
        (words, "report"),
    ],
)
def test_a_change_of_the_code_of_a_stage_does_it_and_those_after_it_again(
    finished: Path, module: ModuleType, first: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    before = stage_fingerprints(finished, monkeypatch)

    def edited(name: str) -> bytes:
        return source_of(name) + b"#" * (name == module.__name__)

    monkeypatch.setattr("locate.pipeline.fingerprint.source_of", edited)
    after = stage_fingerprints(finished, monkeypatch)
    changed = [stage for stage in STAGES if before[stage] != after[stage]]
    assert changed == list(STAGES[STAGES.index(first) :])


def kill_while_it_writes(arguments: list[str], files: str, output: Path, env: Mapping) -> None:
    """Kills the command from outside as soon as a stage has begun to write these files."""
    quiet = subprocess.DEVNULL
    process = subprocess.Popen(arguments, stdout=quiet, stderr=quiet, env=env)
    deadline = time.monotonic() + 300
    while not list(output.glob(f".partial/*/{files}")):
        assert process.poll() is None
        assert time.monotonic() < deadline
        time.sleep(0.02)
    process.send_signal(signal.SIGKILL)
    process.wait()


def test_killed_in_every_stage_it_ends_in_the_same_map(finished: Path, tmp_path: Path) -> None:
    output = tmp_path / "out"
    arguments = ["run", str(SAMPLE_VIDEO), "-o", str(output), "--max-frames", FRAMES]
    other_threads = {**os.environ, "OPENBLAS_NUM_THREADS": "3", "OMP_NUM_THREADS": "3"}
    for stage in STAGES:
        stamp = output / ".stages" / f"{stage}.json"
        if stage in MID_STAGE:
            kill_while_it_writes(command(*arguments), MID_STAGE[stage], output, other_threads)
            assert not stamp.exists()
        python = [sys.executable, "-c", KILLED_BEFORE_ITS_RESULT_IS_KEPT, stage]
        killed = subprocess.run(
            [*python, *arguments], capture_output=True, check=False, env=other_threads
        )
        assert killed.returncode == -signal.SIGKILL, killed.stderr.decode()
        assert not stamp.exists()
    ended = subprocess.run(command(*arguments), capture_output=True, check=False, env=other_threads)
    assert ended.returncode == 0
    for name in ("map.json", "trajectory.json", "plumes.ply"):
        assert (output / name).read_bytes() == (finished / name).read_bytes(), name


def test_given_poses_make_a_metric_map(tmp_path: Path) -> None:
    result = locate(
        "run", SAMPLE_VIDEO, "-o", tmp_path / "out", "--poses", SAMPLE / "truth.json",
        "--max-frames", "30", "--detector", "registered",
    )  # fmt: skip
    assert result.returncode == 0, result.stderr
    plume_map = PlumeMap.load(tmp_path / "out" / "map.json")
    assert (plume_map.units, plume_map.gravity) == ("m", True)
    assert plume_map.detection_limit_px is not None
    truth = json.loads((SAMPLE / "truth.json").read_text())["plumes"][0]["source"]
    (plume,) = plume_map.plumes
    assert np.linalg.norm(plume.source - truth) < 0.03 * 8.5


def test_a_thorough_run_counts_the_displacement_of_more_frames(tmp_path: Path) -> None:
    settings = {"recording": SAMPLE_VIDEO, "poses": SAMPLE / "truth.json", "overlay": False}
    amounts = {"max_frames": 14, "detection_frames": 3, "effort": "thorough"}
    plume_map = Run(RunConfig.of(settings | amounts), tmp_path / "out").run()
    note = "The displacement alone of 5 more frames counts beside 3 measured whole."
    assert note in plume_map.notes
    assert len(list((tmp_path / "out" / "detections").glob("*.npz"))) == 3
    assert not (tmp_path / "out" / "displacements").exists()


def test_a_still_video_gives_a_direction_and_marks_it(tmp_path: Path) -> None:
    images = frames(0.15)
    size = (images[0].shape[1], images[0].shape[0])
    with create_video(tmp_path / "still.mkv", size=size, fps=15, codec=LOSSLESS) as video:
        for image in images:
            video.write(image)
    result = locate("run", tmp_path / "still.mkv", "-o", tmp_path / "run")
    assert result.returncode == 0, result.stderr
    (bearing,) = PlumeMap.load(tmp_path / "run" / "map.json").bearings
    assert bearing.displacement_px < 0.15
    assert "<circle" in (tmp_path / "run" / "report.html").read_text()


def test_frames_are_chosen_anew_where_the_camera_turns_out_to_be_at_rest(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As of coded haze: the image moves, and only the reconstruction says that nothing else did.

    The next run knows, and reconstructs nothing.
    """
    images = frames(1.0, count=40)
    size = (images[0].shape[1], images[0].shape[0])
    with create_video(tmp_path / "haze.mkv", size=size, fps=15, codec=LOSSLESS) as video:
        for image in images:
            video.write(image)
    tried: list[int] = []

    def reconstruct(_: Run, key_frames: KeyFrames) -> None:
        tried.append(len(key_frames))
        raise RegistrationError(RegistrationFailure.STATIC_CAMERA, "the image moves by 3 px in all")

    monkeypatch.setattr(StillnessTest, "is_still", False)
    monkeypatch.setattr(Run, "_register", reconstruct)
    config = RunConfig(recording=tmp_path / "haze.mkv", detection_frames=2)
    for _ in range(2):
        Run(config, tmp_path / "run").run()
        kept = KeyFrames.load(tmp_path / "run" / "frames" / "index.json")
        assert kept.static
        assert len(kept) == 40
    assert len(tried) == 1


def bad(result: subprocess.CompletedProcess[str], code: int, *words: str) -> None:
    assert result.returncode == code, result.stderr
    lines = [line for line in result.stderr.splitlines() if line.startswith("locate: ")]
    assert len(lines) == 1
    assert "Traceback" not in result.stderr
    for word in words:
        assert word in lines[0]


def test_missing_file(tmp_path: Path) -> None:
    bad(locate("run", tmp_path / "no.mp4", "-o", tmp_path / "o"), 2, "no.mp4")


def test_text_that_calls_itself_a_video(tmp_path: Path) -> None:
    (tmp_path / "v.mp4").write_text("not a video\n" * 100)
    bad(locate("run", tmp_path / "v.mp4", "-o", tmp_path / "o"), 2, "v.mp4")


def test_folder_without_images(tmp_path: Path) -> None:
    (tmp_path / "photos").mkdir()
    bad(locate("run", tmp_path / "photos", "-o", tmp_path / "o"), 2, "photos")


def test_output_that_cannot_be_a_folder(tmp_path: Path) -> None:
    (tmp_path / "o").write_text("")
    bad(locate("run", SAMPLE_VIDEO, "-o", tmp_path / "o"), 2, "cannot be written")


def test_run_folder_of_another_version(tmp_path: Path) -> None:
    (tmp_path / "config.yaml").write_text("schema: locate.run/0\n")
    bad(locate("run", SAMPLE_VIDEO, "-o", tmp_path), 2, "locate.run/0")


def test_bos_on_a_moving_camera(tmp_path: Path) -> None:
    result = locate("run", SAMPLE_VIDEO, "-o", tmp_path, "--detector", "bos", "--max-frames", "8")
    bad(result, 2, "camera at rest")


def test_poses_that_are_none(tmp_path: Path) -> None:
    (tmp_path / "p.json").write_text("[]")
    output = tmp_path / "o"
    result = locate("run", SAMPLE_VIDEO, "-o", output, "--poses", tmp_path / "p.json",
                    "--max-frames", "8")  # fmt: skip
    bad(result, 2, "p.json")


def test_telemetry_that_is_none_is_refused_before_any_work(tmp_path: Path) -> None:
    telemetry = tmp_path / "flight.srt"
    telemetry.write_text("nothing that says where")
    config = RunConfig(recording=SAMPLE_VIDEO, telemetry=telemetry)
    with pytest.raises(BadInputError, match=r"flight\.srt"):
        Run(config, tmp_path / "out")
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("given", ["camera", "poses"])
@pytest.mark.parametrize("content", [None, "{}"])
def test_a_camera_or_poses_that_are_none_are_refused_before_frames_are_read(
    tmp_path: Path, given: str, content: str | None
) -> None:
    path = tmp_path / "given.json"
    if content is not None:
        path.write_text(content)
    run = Run(RunConfig.of({"recording": SAMPLE_VIDEO, given: path}), tmp_path / "out")
    with pytest.raises(BadInputError, match=r"given\.json"):
        run.run()
    assert not run.files.frames.exists()


@pytest.mark.parametrize("known", ["camera", "poses"])
def test_a_lens_is_not_estimated_where_the_camera_is_known(tmp_path: Path, known: str) -> None:
    path = tmp_path / "camera.json"
    path.write_text("{}")
    config = RunConfig(recording=SAMPLE_VIDEO, lens="fisheye", **{known: path})
    with pytest.raises(BadInputError, match="--lens fisheye: the camera is known"):
        Run(config, tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_usage_error_is_no_traceback() -> None:
    result = locate("run", "video.mp4", "-o", "out", "--detector", "guess")
    assert result.returncode == 2
    assert "Traceback" not in result.stderr
    assert "guess" in result.stderr


@pytest.fixture
def heeding_ctrl_c() -> Iterator[None]:
    """A job in the background ignores Ctrl-C, and so would its children."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


@pytest.mark.usefixtures("heeding_ctrl_c")
@pytest.mark.parametrize("how", [signal.SIGINT, signal.SIGTERM])
def test_interrupt_says_how_to_go_on(tmp_path: Path, how: signal.Signals) -> None:
    process = subprocess.Popen(
        command("run", SAMPLE_VIDEO, "-o", tmp_path / "out", "--max-frames", FRAMES),
        stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True,
    )  # fmt: skip
    log = tmp_path / "out" / "log.jsonl"
    while not (log.exists() and log.read_text()):
        assert process.poll() is None
        time.sleep(0.02)
    process.send_signal(how)
    _, stderr = process.communicate(timeout=60)
    assert process.returncode == 130
    assert stderr.strip().splitlines()[-1].endswith("the same command goes on from here")
    assert "Traceback" not in stderr
    assert "SIGTERM" not in stderr


def test_mistyped_recording_does_not_spoil_the_folder(tmp_path: Path) -> None:
    output = tmp_path / "o"
    for _ in range(2):
        bad(locate("run", tmp_path / "no.mp4", "-o", output), 2, "no.mp4")


@pytest.mark.parametrize("size", ["1m", "4m"])
def test_full_disk(tmp_path: Path, size: str) -> None:
    small = tmp_path / "small"
    small.mkdir()
    mount = shutil.which("mount")
    mounted = mount and subprocess.run(
        [mount, "-t", "tmpfs", "-o", f"size={size}", "tmpfs", small],
        capture_output=True,
        check=False,
    )
    if not mounted or mounted.returncode != 0:
        pytest.skip("a small tmpfs cannot be mounted here; it takes root")
    try:
        bad(locate("run", SAMPLE_VIDEO, "-o", small / "out", "--max-frames", "14"), 2, "space")
    finally:
        subprocess.run(["umount", small], check=True)
