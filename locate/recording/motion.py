"""How far the image moves between two frames, by sparse Lucas-Kanade tracks."""

import cv2
import numpy as np

from geometry.arrays import BoolArray, FloatArray, GreyImage

MAX_POINTS = 300
"""Most corners that are tracked."""
STILL_PX = 0.1
"""Motion of the whole image below which the camera is at rest, px of the thumbnail."""
STILL_SIDE = 640
"""Longest side of the thumbnail for that test, px."""
_SHIMMER_PX = 1.0
"""Scatter of tracks below which moving air explains the motion, px."""
_DECIDED = 5
"""Excess of moved frames over still ones after which the camera counts as moving."""


def track_corners(reference: GreyImage, image: GreyImage) -> tuple[FloatArray, FloatArray]:
    """Tracks corners of `reference` into `image`.

    Returns:
        (N, 2) positions in the reference and (N, 2) displacements, px.
    """
    corners = cv2.goodFeaturesToTrack(reference, MAX_POINTS, 0.01, 4)
    if corners is None:
        return np.zeros((0, 2)), np.zeros((0, 2))
    moved, status, _ = cv2.calcOpticalFlowPyrLK(
        reference, image, corners, corners.copy(), winSize=(15, 15), maxLevel=3
    )
    kept: BoolArray = status.ravel() > 0
    points = corners.reshape(-1, 2)[kept].astype(float)
    return points, moved.reshape(-1, 2)[kept].astype(float) - points


def median_motion(reference: GreyImage, image: GreyImage) -> float:
    """Median length of the tracks in px; 0 where nothing can be tracked."""
    _, displacements = track_corners(reference, image)
    return float(np.median(np.linalg.norm(displacements, axis=1))) if len(displacements) else 0.0


def measure_sharpness(image: GreyImage) -> float:
    """Variance of the Laplacian, grey levels squared."""
    return float(cv2.Laplacian(image, cv2.CV_32F).var())


def make_thumbnail(image: GreyImage, side: int) -> GreyImage:
    """The image reduced to `side` px on the longest side."""
    factor = min(1.0, side / max(image.shape))
    return np.asarray(
        cv2.resize(image, None, fx=factor, fy=factor, interpolation=cv2.INTER_AREA), dtype=np.uint8
    )


class StillnessTest:
    """Tells a camera on a tripod from a moving one, frame by frame.

    The motion of the whole image is a robust similarity, so a plume does not count. Air that
    shimmers all over moves the image as a whole by no more than it scatters the tracks, and
    scatters them by less than `_SHIMMER_PX`; parallax soon does more.
    """

    def __init__(self, first: GreyImage) -> None:
        self._reference = make_thumbnail(first, STILL_SIDE)
        self._still: list[bool] = []

    def add(self, image: GreyImage) -> None:
        """Measures one more frame, unless the camera is already known to move."""
        if self._still.count(False) <= self._still.count(True) + _DECIDED:
            self._still.append(self._matches_reference(make_thumbnail(image, STILL_SIDE)))

    @property
    def is_still(self) -> bool:
        """True where nine frames in ten are in the place of the first."""
        return self._still.count(True) >= 0.9 * max(len(self._still), 1)

    def _matches_reference(self, image: GreyImage) -> bool:
        points, displacements = track_corners(self._reference, image)
        if len(points) < 10:
            return True
        affine, _ = cv2.estimateAffinePartial2D(points, points + displacements, method=cv2.LMEDS)
        if affine is None:
            return False
        fitted = points @ affine[:, :2].T + affine[:, 2] - points
        scatter_px = float(np.median(np.linalg.norm(displacements - fitted, axis=1)))
        motion_px = float(np.median(np.linalg.norm(fitted, axis=1)))
        return scatter_px < _SHIMMER_PX and motion_px < STILL_PX + scatter_px
