"""The overlay video of a run."""

import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import av
import numpy as np
import pytest

from geometry.arrays import Picture
from locate.map.plume import PlumeMap
from locate.pipeline.overlay import wants_overlay, write_overlay
from locate.recording import KeyFrames
from locate.recording.index import KeyFrame
from locate.recording.posed_frames import PosedFrames
from tests.locate.answers import bearing_ahead, orbit, plume, plume_map

GREY = 120
TRAJECTORY = orbit(6)


def key_frames(spacing_s: float = 0.1, *, is_video: bool = True) -> KeyFrames:
    frames = tuple(
        KeyFrame(
            index=index,
            time_s=spacing_s * row,
            source=f"{index}.jpg",
            sharpness=1.0,
            motion_px=1.0,
        )
        for row, index in enumerate(TRAJECTORY.indices.tolist())
    )
    return KeyFrames(frames=frames, width=64, height=48, is_video=is_video, static=False)


def shown(path: Path, answer: PlumeMap, *, moving: bool = True) -> list[Picture]:
    """The frames of an overlay video in which the second frame alone was measured."""
    posed = PosedFrames(
        folder=path.parent,
        names=[],
        indices=TRAJECTORY.indices,
        camera=TRAJECTORY.camera,
        trajectory=TRAJECTORY if moving else None,
    )
    llr = np.zeros((48, 64), np.float32)
    llr[30:40, 5:15] = 4.0
    write_overlay(
        path,
        ((row, np.full((48, 64, 3), GREY, np.uint8)) for row in range(6)),
        posed=posed,
        key_frames=key_frames(),
        evidence={1: llr},
        plume_map=answer,
    )
    with av.open(str(path)) as video:
        assert float(video.streams.video[0].average_rate or 0) == pytest.approx(10)
        return [frame.to_ndarray(format="bgr24") for frame in video.decode(video=0)]


def drawn(picture: Picture) -> Picture:
    """(H, W) what is in colour, below the label."""
    coloured = np.ptp(picture.astype(int), axis=2) > 30
    coloured[:20] = False
    return coloured


def test_evidence_is_shown_where_it_was_measured(tmp_path: Path) -> None:
    frames = shown(tmp_path / "overlay.mp4", plume_map())
    assert len(frames) == 6
    assert drawn(frames[1])[32:39, 6:14].all()
    assert not any(drawn(frames[row]).any() for row in (0, 2, 3, 4, 5))


def test_plumes_are_outlined_in_every_frame(tmp_path: Path) -> None:
    frames = shown(tmp_path / "overlay.mp4", plume_map(plume()))
    assert all(drawn(frame).any() for frame in frames)


def test_a_camera_at_rest_shows_its_directions(tmp_path: Path) -> None:
    frames = shown(tmp_path / "overlay.mp4", plume_map(bearings=(bearing_ahead(),)), moving=False)
    assert all(drawn(frame)[20:28, 28:36].any() for frame in frames)


def test_a_long_video_has_one_only_where_it_is_asked_for() -> None:
    short, long, photos = key_frames(), key_frames(30.0), key_frames(30.0, is_video=False)
    assert [wants_overlay(None, one) for one in (short, long, photos)] == [True, False, True]
    assert [wants_overlay(asked, short) for asked in (True, False)] == [True, False]
    assert wants_overlay(True, replace(long, static=True))


CODED_IN_STRANGE_MEMORY = """
import sys
from pathlib import Path
from locate.pipeline.overlay import CODING
from locate.recording.sample import SAMPLE_VIDEO
from locate.recording import open_recording
from locate.recording.writer import create_video

with create_video(Path(sys.argv[1]), size=(200, 150), fps=10.0, options=CODING) as video:
    for frame in open_recording(SAMPLE_VIDEO).frames():
        video.write(frame.image[:150, :200])
"""


def test_the_same_frames_are_coded_the_same_whatever_memory_held(tmp_path: Path) -> None:
    for fill in ("1", "129"):
        path = tmp_path / f"{fill}.mp4"
        command = [sys.executable, "-c", CODED_IN_STRANGE_MEMORY, path]
        environment = {**os.environ, "MALLOC_PERTURB_": fill}
        subprocess.run(command, check=True, env=environment)
    assert (tmp_path / "1.mp4").read_bytes() == (tmp_path / "129.mp4").read_bytes()
