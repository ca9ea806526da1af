"""Tests of `locate.recording.frame_memory`: a short recording is decoded once."""

from pathlib import Path

import pytest

from locate.recording import frame_memory, open_recording, select_frames
from locate.recording.recording import Recording
from locate.recording.sample import SAMPLE_VIDEO


def written(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in folder.glob("*.png")}


def test_a_short_recording_is_decoded_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    recording = open_recording(SAMPLE_VIDEO)
    with monkeypatch.context() as patch:
        patch.setattr(frame_memory, "MOST_BYTES", 20 * recording.width * recording.height)
        decoded_again = select_frames(recording, tmp_path / "again", max_frames=12)
    monkeypatch.delattr(Recording, "frames_again")
    assert select_frames(recording, tmp_path / "once", max_frames=12) == decoded_again
    assert written(tmp_path / "once") == written(tmp_path / "again")


def test_motion_is_since_the_kept_frame_before(tmp_path: Path) -> None:
    every = select_frames(open_recording(SAMPLE_VIDEO), tmp_path / "every")
    steps = [frame.motion_px for frame in every.frames]
    assert steps[0] == 0
    assert min(steps[1:]) > 1
    some = select_frames(open_recording(SAMPLE_VIDEO), tmp_path / "some", max_frames=20)
    assert some.frames[5].motion_px > 2 * steps[15]
