"""Which frames of a long video are looked at: the others are decoded and cost no more."""

from collections.abc import Callable
from math import ceil

from locate.recording.video import NamedImage

ENOUGH, FOR_EACH = 3600, 30
"""Frames of a video up to which all are looked at: two minutes, or more for many key frames."""
LONGEST_STEP_S = 0.2
"""Most time between two that are looked at, twice that between B frames: a walker's camera still
shows the same."""
IN_A_ROW = 600
"""Frames in the middle that are all looked at where the camera is at rest."""


def looked_step(expected: int, max_frames: int) -> int:
    """Of how many frames of a video one is looked at, of so many, for so many key frames."""
    return ceil(expected / max(ENOUGH, FOR_EACH * max_frames)) or 1


class LookedAt:
    """Decides frame by frame, in their order, which to look at; B frames are taken last.

    Args:
        expected: How many frames there are; 0 where that is unknown, so that all are looked at.
        max_frames: The most key frames that are wanted.
        is_at_rest: Whether the camera has not moved so far.
    """

    def __init__(self, expected: int, max_frames: int, is_at_rest: Callable[[], bool]) -> None:
        self._step = looked_step(expected, max_frames)
        self._middle = expected // 2
        self._is_at_rest = is_at_rest
        self._last, self._last_s = -self._step, 0.0

    def __call__(self, index: int, image: NamedImage) -> bool:
        """Whether to look at the frame of this index."""
        patience = 2 if image.is_b_frame else 1
        looked = (
            index - self._last > patience * (self._step - 1)
            or abs(image.time_s - self._last_s) > patience * LONGEST_STEP_S
            or (abs(index - self._middle) <= IN_A_ROW // 2 and self._is_at_rest())
        )
        if looked:
            self._last, self._last_s = index, image.time_s
        return looked
