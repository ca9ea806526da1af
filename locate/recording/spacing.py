"""Frames that are even in image motion, sharp and well coded.

Codecs spend the fewest bits on B frames: what a plume displaces is lost there first. They are taken
last wherever frames are chosen, and replaced by what that choice allows: a later frame
(`locate.recording.sampling`), one that has moved about as far (`FrameSpacer`), the nearest other
frame (`avoid_b_frames`), other neighbours where there are enough (`detect.registered.neighbours`).
Frames of which the displacement alone is measured are none (`locate.pipeline.more_frames`).
"""

from collections.abc import Sequence
from dataclasses import dataclass

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


def spread_rows(count: int, most: int) -> IntArray:
    """At most `most` of `count` rows, evenly, the first and the last among them."""
    return np.rint(np.linspace(0, count - 1, min(most, count))).astype(np.int64)


def spread_key_rows(
    count: int,
    most: int,
    *,
    ends: int,
    skip: Sequence[int] | IntArray = (),
    b_frames: Sequence[int] | IntArray = (),
) -> IntArray:
    """At most `most` of `count` rows, evenly, without the `ends` that lack neighbours.

    Args:
        count: Of all rows.
        most: Of those chosen.
        ends: Rows at either end that are left out, as long as one is left between them.
        skip: Others that are left out.
        b_frames: Others that are taken only where no other frame is near (`avoid_b_frames`).
    """
    ends = min(ends, (count - 1) // 2)
    usable = np.setdiff1d(np.arange(ends, count - ends), np.asarray(skip, dtype=np.int64))
    rows = spread_rows(len(usable), most)
    return np.asarray(usable[avoid_b_frames(rows, np.isin(usable, b_frames))])


@dataclass(frozen=True, kw_only=True)
class Candidate:
    """A frame that may be kept.

    Attributes:
        frame: What is known of it.
        thumb: (H, W) of it, reduced.
        before: Index of the frame that was looked at before it; -1 where none was.
        step_px: The motion since that one, px of such thumbnails.
    """

    frame: KeyFrame
    thumb: GreyImage
    before: int
    step_px: float


class FrameSpacer:
    """Keeps the next frame once the image has moved by the target since the last kept one.

    Of those about as far, B frames are the last choice.

    Args:
        first: Kept as it is.
        target_px: The motion wanted, px of the thumbnails.
    """

    def __init__(self, first: Candidate, target_px: float) -> None:
        self.kept = [first.frame]
        self._last = first
        self._target_px = target_px
        self._waiting: list[tuple[float, Candidate]] = []

    def add(self, candidate: Candidate) -> None:
        """Considers the next frame."""
        self._waiting.append((self._ratio(candidate), candidate))
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
        inside = [item for item in inside if not item[1].frame.is_b_frame] or inside
        nearest = min(inside or self._waiting, key=lambda item: abs(item[0] - 1))
        sharpest = max(inside, key=lambda item: item[1].frame.sharpness, default=nearest)
        much_sharper = sharpest[1].frame.sharpness > SHARPER * nearest[1].frame.sharpness
        _, chosen = sharpest if much_sharper else nearest
        rest = [item[1] for item in self._waiting if item[1].frame.index > chosen.frame.index]
        self.kept.append(chosen.frame)
        self._last = chosen
        self._waiting = [(self._ratio(later), later) for later in rest]

    def _ratio(self, candidate: Candidate) -> float:
        """The motion since the last kept frame, over the target."""
        is_next = candidate.before == self._last.frame.index
        motion_px = (
            candidate.step_px if is_next else median_motion(self._last.thumb, candidate.thumb)
        )
        return motion_px / self._target_px
