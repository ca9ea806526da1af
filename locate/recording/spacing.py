"""Frames that are even in image motion, and sharp."""

from geometry.arrays import GreyImage
from locate.recording.index import KeyFrame
from locate.recording.motion import median_motion

WINDOW = 0.25
"""How far the motion may be from the target, over the target."""
SHARPER = 1.2
"""Factor of sharpness from which a frame off the target is preferred."""
MAX_WAITING = 256
"""Most candidates in memory."""


class FrameSpacer:
    """Keeps the next frame once the image has moved by the target since the last kept one.

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
        nearest = min(self._waiting, key=lambda item: abs(item[0] - 1))
        inside = [item for item in self._waiting if abs(item[0] - 1) <= WINDOW]
        sharpest = max(inside, key=lambda item: item[1].sharpness, default=nearest)
        much_sharper = sharpest[1].sharpness > SHARPER * nearest[1].sharpness
        _, chosen, thumb = sharpest if much_sharper else nearest
        rest = [item[1:] for item in self._waiting if item[1].index > chosen.index]
        self.kept.append(chosen)
        self._last = (chosen, thumb)
        self._waiting = [
            (median_motion(thumb, later) / self._target_px, frame, later) for frame, later in rest
        ]
