from pathlib import Path
from typing import Any

import numpy as np
import pytest

from detect.detection import Detection
from locate.map.answer import Cause
from locate.pipeline.obstacles import foreseen_obstacles, measured_obstacles
from locate.recording import KeyFrames, open_recording
from locate.recording.index import KeyFrame
from locate.recording.writer import H264, H265, LOSSLESS, create_video

Causes = list[Cause]


def key_frames(count: int = 60, motion: float = 0.02, **changes: Any) -> KeyFrames:
    """Frames 640 px wide that move by this share of it from one to the next."""
    frames = tuple(
        KeyFrame(
            index=i,
            time_s=i / 30,
            source="video.mp4",
            sharpness=100.0,
            motion_px=640 * motion if i else 0.0,
        )
        for i in range(count)
    )
    fields: dict[str, Any] = {"width": 640, "height": 480, "is_video": True, "static": False}
    return KeyFrames(frames=frames, **fields | changes)


@pytest.mark.parametrize(
    ("recorded", "causes"),
    [
        (key_frames(), []),
        (key_frames(bits_per_pixel=2.0), []),
        (key_frames(count=7), [Cause.FEW_FRAMES]),
        (key_frames(motion=0.1), [Cause.LITTLE_OVERLAP]),
        (key_frames(bits_per_pixel=0.12), [Cause.COARSE_CODING]),
        (key_frames(count=7, motion=0.1, static=True), []),
        (
            key_frames(count=7, motion=0.1, bits_per_pixel=0.12),
            [Cause.FEW_FRAMES, Cause.LITTLE_OVERLAP, Cause.COARSE_CODING],
        ),
    ],
)
def test_obstacles_are_foreseen_in_the_frames(recorded: KeyFrames, causes: Causes) -> None:
    assert [one.cause for one in foreseen_obstacles(recorded)] == causes


def test_coarse_coding_is_named_with_its_codec() -> None:
    (coarse,) = foreseen_obstacles(key_frames(bits_per_pixel=0.12, codec="hevc"))
    assert "(hevc) with 0.12 bits a pixel of 640x480" in coarse.why


@pytest.mark.parametrize(("codec", "loses"), [(LOSSLESS, False), (H264, True), (H265, True)])
def test_how_a_video_is_coded_is_read_from_it(tmp_path: Path, codec: str, loses: bool) -> None:
    path = tmp_path / "film.mkv"
    with create_video(path, size=(96, 64), fps=10, codec=codec) as writer:
        for i in range(5):
            writer.write(np.full((64, 96), 40 * i, np.uint8))
    recording = open_recording(path)
    assert recording.coding is not None
    assert recording.coding.codec == {LOSSLESS: "ffv1", H264: "h264", H265: "hevc"}[codec]
    packets = path.stat().st_size * 8
    if loses:
        assert recording.bits_per_pixel is not None
        assert 0 < recording.bits_per_pixel < packets / (96 * 64)
    else:
        assert recording.bits_per_pixel is None


def detection(judged: float) -> Detection:
    """A frame with evidence on this share of its pixels."""
    llr = np.zeros((40, 50), np.float32)
    llr[: round(40 * judged)] = -0.5
    return Detection(
        displacement=np.zeros((40, 50, 2), np.float32), sigma_px=np.ones_like(llr), llr=llr
    )


@pytest.mark.parametrize(
    ("judged", "depth", "causes"),
    [
        ([0.0] * 4, False, [Cause.NO_PARALLAX, Cause.SILENT_FRAMES]),
        ([0.0, 0.0, 0.0, 0.9], True, [Cause.SILENT_FRAMES]),
        ([0.0, 0.2, 0.2, 0.2], True, [Cause.UNJUDGED_PIXELS]),
        ([0.9] * 4, True, [Cause.NOISE]),
    ],
)
def test_a_cause_is_always_named(judged: list[float], depth: bool, causes: Causes) -> None:
    named = measured_obstacles([detection(share) for share in judged], depth=depth)
    assert [one.cause for one in named] == causes
    for one in named:
        assert one.why.endswith(".")
        assert one.remedy.endswith(".")
