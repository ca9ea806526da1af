from typing import Any

import numpy as np
import pytest

from detect.detection import Detection
from locate.map.answer import Cause
from locate.pipeline.obstacles import foreseen_obstacles, measured_obstacles
from locate.recording import KeyFrames
from locate.recording.index import KeyFrame

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
