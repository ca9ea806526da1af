"""Two detectors on one frame, and one answer."""

import numpy as np

from detect.detection import Detection, Detector, Frames
from detect.evidence import LLR_MAX, LLR_MIN
from geometry.arrays import FloatMap

SEPARATOR = "+"
"""Joins the names of two detectors."""
ERROR_CORRELATION = 0.5
"""Correlation that the errors of two detectors on one frame are taken to have."""


class FusedDetector:
    """A detector that another one helps, where that one has something to say.

    The two measure different things, a frame against others and the texture within it, so their
    evidence adds up; but noise, compression and whatever moves in the frame reach both, so what
    the helper measures counts as 1 - `shared` of it wherever both have evidence. The sum stays
    within the bounds of any single one.

    Args:
        first: Is believed as it is.
        second: Helps; where its llr is 0 it changes nothing.
        shared: Correlation of their errors: at 0 the evidence is summed, at 1 the second only
            fills in where the first has no evidence.
    """

    def __init__(
        self, first: Detector, second: Detector, *, shared: float = ERROR_CORRELATION
    ) -> None:
        self.name = f"{first.name}{SEPARATOR}{second.name}"
        self.response = first.response
        self.uses_other_frames = first.uses_other_frames or second.uses_other_frames
        self._first, self._second = first, second
        self._shared = shared

    def detect(self, frames: Frames, index: int) -> Detection:
        """Measures frame `index` with both."""
        return fuse_pair(
            self._first.detect(frames, index), self._second.detect(frames, index), self._shared
        )


def fuse_pair(first: Detection, second: Detection, shared: float) -> Detection:
    """One detection of two of the same frame; see `FusedDetector`."""
    weight = np.where(first.llr == 0, 1, 1 - shared)
    llr = np.clip(first.llr + weight * second.llr, LLR_MIN, LLR_MAX)
    helped = (second.llr != 0) & np.isfinite(second.sigma_px)
    a = 1 / first.sigma_px
    b = np.where(helped, 1 / second.sigma_px, 0).astype(np.float32)
    total = a * a + b * b
    known = total > 0
    share = np.divide(b * b, total, out=np.zeros_like(total), where=known)
    excess = np.divide(2 * shared * a * b, total, out=np.zeros_like(total), where=known)
    variance = np.divide(1 + excess, total, out=np.full_like(total, np.inf), where=known)
    return Detection(
        displacement=_interpolate_field(first.displacement, second.displacement, share),
        sigma_px=np.sqrt(variance),
        llr=llr.astype(np.float32),
        inverse_depth=first.inverse_depth,
        information=first.information,
    )


def _interpolate_field(start: FloatMap, end: FloatMap, share: FloatMap) -> FloatMap:
    """(H, W, 2), by the inverse variances, which is the best for errors that are not shared."""
    start, end = (np.where(np.isfinite(field), field, 0) for field in (start, end))
    return (start + share[..., None] * (end - start)).astype(np.float32)
