"""What the stage that registers says of the poses beside them."""

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from geometry.reports import ignore_report
from geometry.trajectory import Trajectory
from locate.pipeline import poses
from locate.pipeline.config import RunConfig
from locate.pipeline.files import RunFiles
from locate.pipeline.source import RecordingSource
from locate.recording import KeyFrame, KeyFrames
from locate.simulation.evidence import orbit_trajectory

LOST = "key frames 7 and 8 share 41 features (needs 100)"


def notes_of(
    folder: Path,
    monkeypatch: pytest.MonkeyPatch,
    *,
    lost: str | None,
    is_video: bool,
    focal_sigma_px: float | None = 0.5,
) -> tuple[str, ...]:
    """The notes where structure from motion reports this."""
    trajectory = orbit_trajectory(9, 40)
    found = SimpleNamespace(
        trajectory=trajectory,
        report={"method": "global", "tracks_lost": lost, "focal_sigma_px": focal_sigma_px},
        save=lambda sfm: sfm.mkdir(parents=True),
    )
    monkeypatch.setattr(poses, "call_apart", lambda *_args, **_kwargs: found)
    frames = tuple(
        KeyFrame(index=i, time_s=0.1 * i, source="a.mp4", sharpness=50.0, motion_px=9.0)
        for i in range(9)
    )
    key_frames = KeyFrames(frames=frames, width=640, height=480, is_video=is_video, static=False)
    source = RecordingSource(config=RunConfig(recording=folder / "a.mp4"), bag=None)
    files = RunFiles(folder)
    poses.reconstruct_poses(source, key_frames, files, files, ignore_report)
    return poses.load_pose_notes(files)


def test_a_video_whose_tracks_break_has_a_note(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (note,) = notes_of(tmp_path, monkeypatch, lost=LOST, is_video=True)
    assert note == f"poses come from SIFT matches and not from feature tracks: {LOST}"


def test_a_focal_length_that_the_path_hardly_shows_has_a_note(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (note,) = notes_of(tmp_path, monkeypatch, lost=None, is_video=True, focal_sigma_px=8.4)
    assert "280 px" in note
    assert "3.0%" in note
    assert "--focal" in note


def test_a_given_focal_length_has_no_note(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert notes_of(tmp_path, monkeypatch, lost=None, is_video=True, focal_sigma_px=None) == ()


@pytest.mark.parametrize(("lost", "is_video"), [(None, True), (LOST, False)])
def test_no_note_with_tracks_and_none_of_photos(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, lost: str | None, is_video: bool
) -> None:
    assert notes_of(tmp_path, monkeypatch, lost=lost, is_video=is_video) == ()


@pytest.mark.parametrize("is_video", [True, False])
def test_poses_of_a_video_that_jump_off_the_path_are_left_out(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, is_video: bool
) -> None:
    path = orbit_trajectory(20, 60)
    rows = np.arange(20)
    rows[[4, 13]] = rows[[13, 4]]
    swapped = replace(path, rotations=path.rotations[rows], translations=path.translations[rows])
    given = SimpleNamespace(path="poses.txt", match_to_frames=lambda *_, **__: (swapped, ""))
    monkeypatch.setattr(poses, "check_given_poses", lambda *_: ())
    frames = tuple(
        KeyFrame(index=i, time_s=0.2 * i, source="a.mp4", sharpness=50.0, motion_px=9.0)
        for i in range(20)
    )
    key_frames = KeyFrames(frames=frames, width=320, height=240, is_video=is_video, static=False)
    files = RunFiles(tmp_path)
    poses.adopt_poses(given, key_frames, files, files)
    adopted = Trajectory.load(files.sfm_trajectory).indices.tolist()
    if is_video:
        assert adopted == [i for i in range(20) if i not in (4, 13)]
        (note,) = poses.load_pose_notes(files)
        assert "frames 4, 13" in note
    else:
        assert adopted == list(range(20))
        assert poses.load_pose_notes(files) == ()
