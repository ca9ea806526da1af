"""Frames that are even in image motion, sharp and well coded."""

import numpy as np

from geometry.arrays import BoolArray, GreyImage, IntArray
from locate.recording.index import KeyFrame
from locate.recording.motion import median_motion

WINDOW = 0.25
"""How far the motion may be from the target, over the target."""
SHARPER = 1.2
"""Factor of sharpness from which a frame off the target is preferred."""
MAX_WAITING = 256
"""Most candidates in memory."""


def avoid_b_frames(rows: IntArray, is_b_frame: BoolArray) -> IntArray:
    """Chosen rows, with B frames among them exchanged for the nearest other frames.

    Codecs spend the fewest bits on B frames: what a plume displaces is lost there first.

    Args:
        rows: (M,) chosen, rising.
        is_b_frame: (N,) of all frames.

    Returns:
        (M,) rising; none is moved further than half way to the next chosen row.
    """
    others = np.flatnonzero(~is_b_frame)
    nearest_chosen = np.searchsorted((rows[:-1] + rows[1:]) / 2, others)
    moved = rows.copy()
    for k, row in enumerate(rows):
        near = others[nearest_chosen == k]
        if len(near):
            moved[k] = near[np.argmin(np.abs(near - row))]
    return moved


class FrameSpacer:
    """Keeps the next frame once the image has moved by the target since the last kept one.

    Of those about as far, B frames are the last choice.

    Args:
        first: Kept as it is.
        thumb: (H, W) of it, reduced.
        target_px: The motion wanted, px of such thumbnails.
    """

    def __init__(self, first: KeyFrame, thumb: GreyImage, target_px: float) -> None:
        self.kept = [first]
        self._last = (first, thumb)
        self._target_px = target_px
        self._waiting: list[tuple[float, KeyFrame, GreyImage]] = []

    def add(self, frame: KeyFrame, thumb: GreyImage) -> None:
        """Considers the next frame."""
        motion_px = median_motion(self._last[1], thumb)
        self._waiting.append((motion_px / self._target_px, frame, thumb))
        while self._waiting and (
            self._waiting[-1][0] >= 1 + WINDOW or len(self._waiting) >= MAX_WAITING
        ):
            self._keep_best()
        inside = [item for item in self._waiting if item[0] >= 1 - WINDOW]
        self._waiting = inside or self._waiting[-1:]

    def finish(self) -> list[KeyFrame]:
        """The kept frames, the last with them where it has moved far enough."""
        if self._waiting and self._waiting[-1][0] >= 1 - WINDOW:
            self._keep_best()
        return self.kept

    def _keep_best(self) -> None:
        inside = [item for item in self._waiting if abs(item[0] - 1) <= WINDOW]
        inside = [item for item in inside if not item[1].is_b_frame] or inside
        nearest = min(inside or self._waiting, key=lambda item: abs(item[0] - 1))
        sharpest = max(inside, key=lambda item: item[1].sharpness, default=nearest)
        much_sharper = sharpest[1].sharpness > SHARPER * nearest[1].sharpness
        _, chosen, thumb = sharpest if much_sharper else nearest
        rest = [item[1:] for item in self._waiting if item[1].index > chosen.index]
        self.kept.append(chosen)
        self._last = (chosen, thumb)
        self._waiting = [
            (median_motion(thumb, later) / self._target_px, frame, later) for frame, later in rest
        ]
