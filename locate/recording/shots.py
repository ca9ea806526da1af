"""Where a video is cut: several shots in one file."""

from enum import Enum

import cv2
import numpy as np

from geometry.arrays import FloatArray, GreyImage, IntArray
from locate.recording.motion import MAX_POINTS

LOST_SHARE = 0.2
"""Share of the corners still found below which neighbours have lost each other; chosen."""
RETURN_PX = 1.0
"""Distance from itself to which a corner comes back, tracked there and back, px."""
LEAST_LIKENESS = 0.7
"""Correlation of the surroundings of a corner and of where it was found, for the same corner."""
PATCH = 11
"""Side of those surroundings, px."""
LAYOUT_CHANGE = 0.1
"""Least change of the histograms at a cut: the share of the pixels whose grey level moved. A
carried camera changes 0.03 from frame to frame, cuts in real videos 0.15 and more."""
CELLS, BINS = 4, 16
"""Cells of the image on each side, and grey levels, of those histograms."""
STEADY = 2
"""Neighbours that found each other before a cut: motion too fast to follow begins less abruptly."""
CONFIRMING = 4
"""Frames after a cut that must follow each other, and not show what was before it, as a flash."""
CONFIRMING_END = 2
"""The same where the video ends sooner."""
COMMON_FEATURES = 12
"""Features that agree on one motion where two images show the same."""
FEATURES, RATIO, AGREE_PX = 400, 0.8, 4.0
"""Most features of an image, how much better the best match must be than the second, and how
well they agree, px."""


class Continuity(Enum):
    """How a frame goes on from those before."""

    SAME = "same shot"
    UNSURE = "not known yet"
    CUT = "new shot"


class CutFinder:
    """Finds cuts as the frames come in; a verdict holds for every frame since the last one."""

    def __init__(self) -> None:
        self._previous: GreyImage | None = None
        self._before: GreyImage | None = None
        self._followed: list[bool] = []
        self._steady = 0

    def add(self, image: GreyImage) -> Continuity:
        """Compares the next frame, (H, W), all of one size."""
        previous, self._previous = self._previous, image
        if previous is None:
            return Continuity.SAME
        if self._before is not None:
            return self._confirm(self._before, previous, image)
        lost = _has_lost(previous, image)
        suspected = lost and self._steady >= STEADY
        self._steady = 0 if lost else self._steady + 1
        if not suspected or shows_the_same(previous, image):
            return Continuity.SAME
        self._before, self._followed = previous, []
        return Continuity.UNSURE

    def finish(self) -> Continuity:
        """The verdict on the last frames."""
        if self._before is None:
            return Continuity.SAME
        return self._decide(CONFIRMING_END)

    def _confirm(self, before: GreyImage, previous: GreyImage, image: GreyImage) -> Continuity:
        self._followed.append(not _has_lost(previous, image))
        if shows_the_same(before, image):
            self._before, self._steady = None, 0
            return Continuity.SAME
        return self._decide(CONFIRMING) if len(self._followed) >= CONFIRMING else Continuity.UNSURE

    def _decide(self, needed: int) -> Continuity:
        followed, self._before = self._followed, None
        is_cut = len(followed) >= needed and all(followed)
        self._steady = len(followed) if is_cut else 0
        return Continuity.CUT if is_cut else Continuity.SAME


def _has_lost(before: GreyImage, after: GreyImage) -> bool:
    """The image has changed, and few corners of one frame are found in the next."""
    before, after = _with_equal_levels(before, after)
    if _layout_change(before, after) < LAYOUT_CHANGE:
        return False
    corners = cv2.goodFeaturesToTrack(before, MAX_POINTS, 0.01, 4)
    if corners is None:
        return False
    there, found, _ = cv2.calcOpticalFlowPyrLK(before, after, corners, corners.copy())
    back, found_back, _ = cv2.calcOpticalFlowPyrLK(after, before, there, there.copy())
    gap_px = np.linalg.norm((back - corners).reshape(-1, 2), axis=1)
    kept = (found.ravel() > 0) & (found_back.ravel() > 0) & (gap_px < RETURN_PX)
    alike = _likeness(before, corners[kept], after, there[kept]) > LEAST_LIKENESS
    return bool(np.count_nonzero(alike) < LOST_SHARE * len(corners))


def _with_equal_levels(a: GreyImage, b: GreyImage) -> tuple[GreyImage, GreyImage]:
    """Both with the grey levels of the one that has fewer: a flash or an exposure undone."""
    counts_a, counts_b = (np.bincount(each.ravel(), minlength=256) for each in (a, b))
    if np.count_nonzero(counts_a) >= np.count_nonzero(counts_b):
        return _with_levels(a, counts_a, counts_b), b
    return a, _with_levels(b, counts_b, counts_a)


def _with_levels(image: GreyImage, own: IntArray, wanted: IntArray) -> GreyImage:
    """The image by the rising map of grey levels that gives it this histogram."""
    middle = np.cumsum(own) - own / 2
    levels = np.searchsorted(np.cumsum(wanted), middle * wanted.sum() / own.sum())
    return np.asarray(levels.clip(0, 255).astype(np.uint8)[image])


def _likeness(
    before: GreyImage, corners: FloatArray, after: GreyImage, there: FloatArray
) -> FloatArray:
    """(N,) correlation of the surroundings of each corner in both frames."""
    size = (PATCH, PATCH)
    values = np.zeros(len(corners))
    for row, (here, found) in enumerate(
        zip(corners.reshape(-1, 2), there.reshape(-1, 2), strict=True)
    ):
        a = cv2.getRectSubPix(before, size, here.tolist())
        b = cv2.getRectSubPix(after, size, found.tolist())
        values[row] = cv2.matchTemplate(a, b, cv2.TM_CCOEFF_NORMED)[0, 0]
    return values


def _layout_change(before: GreyImage, after: GreyImage) -> float:
    """Mean share of the pixels of a cell whose grey level moved to another bin."""
    a, b = _cell_histograms(before), _cell_histograms(after)
    return float(np.abs(a - b).sum(axis=1).mean() / 2)


def _cell_histograms(image: GreyImage) -> FloatArray:
    bins = image // (256 // BINS)
    cells = [
        cell
        for row in np.array_split(bins, CELLS, axis=0)
        for cell in np.array_split(row, CELLS, axis=1)
    ]
    return np.array([np.bincount(cell.ravel(), minlength=BINS) / cell.size for cell in cells])


def shows_the_same(a: GreyImage, b: GreyImage) -> bool:
    """Whether features of both agree on one motion of the image, however large."""
    finder = cv2.SIFT.create(FEATURES, contrastThreshold=0.02)
    points_a, in_a = finder.detectAndCompute(a, None)
    points_b, in_b = finder.detectAndCompute(b, None)
    if in_a is None or in_b is None or min(len(in_a), len(in_b)) < COMMON_FEATURES:
        return False
    pairs = [
        pair
        for pair in cv2.BFMatcher(cv2.NORM_L2).knnMatch(in_a, in_b, k=2)
        if len(pair) == 2 and pair[0].distance < RATIO * pair[1].distance
    ]
    if len(pairs) < COMMON_FEATURES:
        return False
    here = np.array([points_a[best.queryIdx].pt for best, _ in pairs])
    there = np.array([points_b[best.trainIdx].pt for best, _ in pairs])
    _, agree = cv2.estimateAffinePartial2D(
        here, there, method=cv2.RANSAC, ransacReprojThreshold=AGREE_PX
    )
    return agree is not None and int(agree.sum()) >= COMMON_FEATURES
