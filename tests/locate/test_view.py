"""`locate view`: what it writes, read back with Rerun's own reader."""

import json
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from typer.testing import CliRunner

from detect.detection import Detection
from geometry.arrays import FloatArray
from geometry.errors import BadInputError
from geometry.trajectory import Trajectory
from locate.commands import view as command
from locate.commands.app import app
from locate.export.rays import rays_of_evidence
from locate.export.report.scene import N_SIGMA
from locate.export.viewing import NOT_MEASURED
from locate.map.plume import Bearing, PlumeMap
from locate.pipeline.config import RunConfig
from locate.pipeline.detections import DetectionIndex
from locate.pipeline.points import save_points
from locate.pipeline.run_folder import RunFolder
from locate.pipeline.view import write_view
from locate.recording import KeyFrames
from locate.recording.index import KeyFrame
from tests.locate.answers import SOURCE, orbit, plume, plume_map

pytest.importorskip("rerun", reason="the extra `view` is not installed")

MEASURED = (4, 12)
"""Indices of the frames in which something was measured."""
POINTS = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 2.0]])
BACKGROUND = 12.0


def detection(trajectory: Trajectory, index: int) -> Detection:
    """Evidence around the source, before a background that is `BACKGROUND` deep."""
    llr = np.zeros((48, 64), np.float32)
    row = trajectory.indices.tolist().index(index)
    u, v = np.rint(trajectory.project(row, SOURCE)).astype(int)
    llr[v, u] = 4.0
    shift = np.zeros((48, 64, 2), np.float32)
    shift[v, u] = (0.5, 0.0)
    return Detection(
        displacement=shift,
        sigma_px=np.full((48, 64), 0.1, np.float32),
        llr=llr,
        inverse_depth=np.full((48, 64), 1 / BACKGROUND, np.float32),
    )


def finished_run(
    root: Path, answer: PlumeMap, *, at_rest: bool = False, is_video: bool = True
) -> Path:
    """A run folder as far as the viewer reads it."""
    trajectory = orbit(metric=True, gravity=True)
    folder = RunFolder(root)
    folder.save_config(RunConfig(recording=root / "gone.mp4").to_plain())
    files = folder.files
    files.frames.mkdir()
    files.detections.mkdir()
    kept = [
        KeyFrame(index=index, time_s=index / 20, source="gone.mp4", sharpness=1.0, motion_px=1.0)
        for index in trajectory.indices.tolist()
    ]
    for frame in kept:
        image = np.full((48, 64), 5 * frame.index, np.uint8)
        cv2.imwrite(str(files.frames / frame.name), image)
    KeyFrames(frames=tuple(kept), width=64, height=48, is_video=is_video, static=at_rest).save(
        files.frame_index
    )
    for index in MEASURED:
        detection(trajectory, index).save(files.detections / f"{index:06d}.npz")
    DetectionIndex(detector="registered", indices=list(MEASURED)).save(files.detections)
    if not at_rest:
        trajectory.save(files.trajectory)
        save_points(files.points, POINTS)
    answer.save(files.map)
    return root


class Recording:
    """What is in an .rrd: for each entity and component, values by frame; None for static ones."""

    def __init__(self, path: Path) -> None:
        from rerun.chunk import RrdReader

        self.values: dict[tuple[str, str], dict[int | None, Any]] = {}
        self.timelines: set[str] = set()
        for chunk in RrdReader(path).stream():
            self.timelines |= set(chunk.timeline_names)
            columns = chunk.to_record_batch().to_pydict()
            rows = columns.get("frame", [None] * chunk.num_rows)
            for name in columns.keys() - {"frame", "recording_time"}:
                cells = zip(rows, columns[name], strict=True)
                known = self.values.setdefault((chunk.entity_path, name), {})
                known.update({row: value for row, value in cells if value is not None})

    def static(self, entity: str, component: str) -> Any:
        return self.values[f"/world{entity}", component][None]

    def by_frame(self, entity: str, component: str) -> dict[int | None, Any]:
        return self.values[f"/world{entity}", component]


@pytest.fixture
def recording(tmp_path: Path) -> Recording:
    root = finished_run(tmp_path / "run", plume_map(plume()))
    write_view(root, tmp_path / "run.rrd")
    return Recording(tmp_path / "run.rrd")


def matrix(value: Any) -> FloatArray:
    """Of a cell with one 3x3 matrix, which is stored by columns."""
    return np.reshape(value[0], (3, 3)).T


def test_camera_projects_the_source_where_the_run_does(recording: Recording) -> None:
    trajectory = orbit()
    turns = recording.by_frame("/camera", "Transform3D:mat3x3")
    places = recording.by_frame("/camera", "Transform3D:translation")
    K = matrix(recording.static("/camera", "Pinhole:image_from_camera"))
    assert list(turns) == trajectory.indices.tolist()
    for row, index in enumerate(trajectory.indices.tolist()):
        in_cam = matrix(turns[index]).T @ (SOURCE - places[index][0])
        u, v, w = K @ in_cam
        # Rerun's origin is the upper left corner of the upper left pixel.
        expected = trajectory.project(row, SOURCE) + 0.5
        np.testing.assert_allclose([u / w, v / w], expected, atol=1e-3)


def test_ellipsoid_is_that_of_the_covariance(recording: Recording) -> None:
    entity = "/plumes/1/covariance"
    sizes = np.array(recording.static(entity, "Ellipsoids3D:half_sizes")[0]) / N_SIGMA
    turn = Rotation.from_quat(recording.static(entity, "Ellipsoids3D:quaternions")[0]).as_matrix()
    covariance = turn @ np.diag(sizes**2) @ turn.T
    np.testing.assert_allclose(covariance, plume().source_covariance, rtol=1e-4, atol=1e-9)
    np.testing.assert_allclose(recording.static(entity, "Ellipsoids3D:centers")[0], SOURCE)


def test_both_clocks_are_there_and_every_frame_has_its_picture(recording: Recording) -> None:
    assert recording.timelines == {"frame", "recording_time"}
    pictures = recording.by_frame("/camera/frame", "EncodedImage:blob")
    for index, blob in pictures.items():
        shown = cv2.imdecode(np.array(blob[0], np.uint8), cv2.IMREAD_GRAYSCALE)
        assert shown.shape == (48, 64)
        np.testing.assert_allclose(shown, 5 * index, atol=1)
    assert list(pictures) == orbit().indices.tolist()


def test_frames_are_in_the_colours_of_photos_that_are_still_there(tmp_path: Path) -> None:
    photos = tmp_path / "photos"
    photos.mkdir()
    root = finished_run(tmp_path / "run", plume_map(), is_video=False)
    for index in orbit().indices.tolist():
        shown = np.full((48, 64, 3), (200, 40, 5 * index), np.uint8)
        cv2.imwrite(str(photos / f"{index:02d}.png"), shown)
        cv2.imwrite(str(photos / f"{index + 1:02d}.png"), shown)
    RunFolder(root).save_config(RunConfig(recording=photos).to_plain())
    write_view(root, tmp_path / "run.rrd")
    pictures = Recording(tmp_path / "run.rrd").by_frame("/camera/frame", "EncodedImage:blob")
    for index, blob in pictures.items():
        shown = cv2.imdecode(np.array(blob[0], np.uint8), cv2.IMREAD_COLOR)
        np.testing.assert_allclose(shown.reshape(-1, 3).mean(0), (200, 40, 5 * index), atol=4)


@pytest.mark.parametrize(
    ("entity", "empty"), [("/camera/evidence", 0), ("/camera/displacement", NOT_MEASURED)]
)
def test_pictures_of_what_was_not_measured_are_empty(
    recording: Recording, entity: str, empty: int
) -> None:
    pictures = recording.by_frame(entity, "EncodedImage:blob")
    for index, blob in pictures.items():
        shown = cv2.imdecode(np.array(blob[0], np.uint8), cv2.IMREAD_UNCHANGED)
        assert shown.shape[:2] == (48, 64)
        assert (shown != empty).any() == (index in MEASURED)
    assert list(pictures) == orbit().indices.tolist()


def test_rays_are_of_measured_frames_alone(recording: Recording) -> None:
    assert set(recording.by_frame("/rays", "LineStrips3D:strips")) == set(MEASURED)
    cleared = set(recording.by_frame("/rays", "Clear:is_recursive"))
    assert cleared == set(orbit().indices.tolist()) - set(MEASURED)


def test_rays_meet_at_the_source_and_end_on_the_background() -> None:
    trajectory = orbit()
    for index in MEASURED:
        row = trajectory.indices.tolist().index(index)
        measured = detection(trajectory, index)
        rays = rays_of_evidence(trajectory, row, measured, longest=100.0)
        assert rays.llr.tolist() == [4.0]
        start, end = rays.segments_in_world[0]
        along = (end - start) / np.linalg.norm(end - start)
        off = np.linalg.norm(np.cross(SOURCE - start, along))
        assert off < 0.15  # half a pixel's diagonal at a range of 8, focal length 60 px
        assert trajectory.world_to_cam(row, end)[2] == pytest.approx(BACKGROUND, rel=1e-3)
        unknown = replace(measured, inverse_depth=None)
        far = rays_of_evidence(trajectory, row, unknown, longest=100.0).segments_in_world[0]
        assert np.linalg.norm(far[1] - far[0]) == pytest.approx(100.0)


def test_a_frame_whose_evidence_is_weak_has_no_rays(tmp_path: Path) -> None:
    root = finished_run(tmp_path / "run", plume_map(plume()))
    weak = replace(detection(orbit(), 4), llr=np.full((48, 64), 0.2, np.float32))
    weak.save(root / "detections" / "000004.npz")
    write_view(root, tmp_path / "run.rrd")
    rays = Recording(tmp_path / "run.rrd").by_frame("/rays", "LineStrips3D:strips")
    assert {index: len(strips) for index, strips in rays.items()} == {4: 0, 12: 1}


def test_photos_have_no_time(tmp_path: Path) -> None:
    root = finished_run(tmp_path / "run", plume_map(), is_video=False)
    write_view(root, tmp_path / "run.rrd")
    assert Recording(tmp_path / "run.rrd").timelines == {"frame"}


def test_a_camera_at_rest_shows_directions(tmp_path: Path) -> None:
    bearing = Bearing(
        direction_in_cam=np.array([0.0, -0.6, 0.8]),
        sigma_rad=0.01, evidence_nats=20.0, probability=0.99, displacement_px=0.5,
    )  # fmt: skip
    root = finished_run(tmp_path / "run", plume_map(bearings=(bearing,)), at_rest=True)
    write_view(root, tmp_path / "run.rrd")
    recording = Recording(tmp_path / "run.rrd")
    arrow = recording.static("/bearings/1", "Arrows3D:vectors")[0]
    np.testing.assert_allclose(arrow, bearing.direction_in_cam)
    assert ("/world/camera", "Transform3D:translation") not in recording.values
    assert ("/world/rays", "LineStrips3D:strips") not in recording.values


def run_view(*arguments: object) -> Any:
    return CliRunner().invoke(app, ["view", *map(str, arguments)])


def test_command_writes_a_file_or_starts_the_viewer(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    root = finished_run(tmp_path / "run", plume_map(plume()))
    saved = tmp_path / "run.rrd"
    assert run_view(root, "--save", saved).exit_code == 0
    assert saved.read_bytes()[:3] == b"RRF"
    seen = tmp_path / "seen.json"
    script = "import json, sys; open(sys.argv[1], 'w').write(json.dumps(sys.argv[2:]))"
    monkeypatch.setattr(command, "VIEWER", (sys.executable, "-c", script, str(seen)))
    assert run_view(root).exit_code == 0
    (path,) = json.loads(seen.read_text())
    assert path.endswith(".rrd")
    assert not Path(path).exists()


@pytest.mark.parametrize("ours", [True, False])
def test_viewer_reports_nothing_to_its_makers(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, *, ours: bool
) -> None:
    monkeypatch.delenv("CI", raising=False)
    for name in ("HOME", "XDG_CONFIG_HOME", "XDG_DATA_HOME"):
        monkeypatch.setenv(name, str(tmp_path))
    if ours:
        monkeypatch.setenv(command.FORCED_REPORTS, "1")
    subprocess.run(
        [sys.executable, "-m", "rerun", "rrd", "stats", str(tmp_path / "missing.rrd")],
        env=command.viewer_environment() if ours else None,
        capture_output=True,
        check=False,
    )
    assert bool([*tmp_path.rglob("analytics/*.json")]) != ours


def test_viewer_that_does_not_start_is_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    root = finished_run(tmp_path / "run", plume_map())
    monkeypatch.setattr(command, "VIEWER", (sys.executable, "-c", "raise SystemExit(1)"))
    with pytest.raises(BadInputError, match=r"--save FILE.rrd"):
        command.view(root)


def test_without_the_extra_the_line_says_what_to_install(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    root = finished_run(tmp_path / "run", plume_map())
    monkeypatch.setitem(sys.modules, "rerun.blueprint", None)
    with pytest.raises(BadInputError, match=r"pip install 'plume-locate\[view\]'"):
        write_view(root, tmp_path / "run.rrd")


@pytest.mark.parametrize("lost", ["frames", "detections"])
def test_a_cleaned_folder_is_told(tmp_path: Path, lost: str) -> None:
    root = finished_run(tmp_path / "run", plume_map())
    (root / lost).rename(tmp_path / lost)
    with pytest.raises(BadInputError, match=f"{lost}: is gone; repeat the run"):
        write_view(root, tmp_path / "run.rrd")


def test_other_names_and_folders_are_refused(tmp_path: Path) -> None:
    root = finished_run(tmp_path / "run", plume_map())
    with pytest.raises(BadInputError, match=r"end in \.rrd"):
        write_view(root, tmp_path / "run.txt")
    with pytest.raises(BadInputError, match=r"map\.json: cannot be read"):
        write_view(tmp_path, tmp_path / "run.rrd")
    assert not (tmp_path / "run.rrd").exists()
