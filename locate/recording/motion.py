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

LEAST_TEXTURE = 0.25
"""Texture below which an image shows nothing, grey levels a px: grain of two levels has less."""
TEXTURED_CELLS = 10
"""How many of the cells of an image must be as textured as is said of the whole."""
_CELLS = 8
"""Those cells on each side."""
_GRAIN_PX, _BLOCK_PX = 1.5, 9
"""Blur that takes grain away, and side of the surroundings that make a corner, px."""
_CONTRAST_RATIO = 1.25
"""Ratio of the contrasts of two images from which one is matched to the other."""
_TRACKABLE = 10
"""Fewest corners by which a motion is measured."""


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


def measure_texture(thumb: GreyImage) -> float:
    """How strongly an image varies both ways in its more textured cells, grey levels a px.

    Grain, an edge alone and a gradient have none: black, white, faded and blurred frames.

    Args:
        thumb: (H, W), of about 320 px on the longest side.
    """
    smooth = cv2.GaussianBlur(thumb.astype(np.float32), (0, 0), _GRAIN_PX)
    along_x = cv2.Sobel(smooth, cv2.CV_32F, 1, 0, scale=1 / 8)
    along_y = cv2.Sobel(smooth, cv2.CV_32F, 0, 1, scale=1 / 8)
    block = (_BLOCK_PX, _BLOCK_PX)
    xx, yy, xy = (
        cv2.boxFilter(product, -1, block)
        for product in (along_x * along_x, along_y * along_y, along_x * along_y)
    )
    weakest = (xx + yy) / 2 - np.sqrt(((xx - yy) / 2) ** 2 + xy**2)
    cells = [
        float(cell.max())
        for row in np.array_split(weakest, _CELLS, axis=0)
        for cell in np.array_split(row, _CELLS, axis=1)
        if cell.size
    ]
    strong = sorted(cells, reverse=True)[:TEXTURED_CELLS]
    return float(np.sqrt(max(strong[-1], 0.0)))


def match_contrast(image: GreyImage, reference: GreyImage) -> GreyImage:
    """The image with the mean and contrast of the reference, where these are far apart."""
    (mean, spread), (wanted_mean, wanted) = (
        (float(each.mean()), float(each.std())) for each in (image, reference)
    )
    ratio = max(wanted, 1e-3) / max(spread, 1e-3)
    if 1 / _CONTRAST_RATIO < ratio < _CONTRAST_RATIO:
        return image
    matched = (image.astype(np.float32) - mean) * ratio + wanted_mean
    return np.asarray(np.rint(matched).clip(0, 255), dtype=np.uint8)


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
    scatters them by less than `_SHIMMER_PX`; parallax soon does more. Where nothing can be measured
    the camera is not called still.

    Args:
        first: The frame that the others are compared with; it must show texture.
    """

    def __init__(self, first: GreyImage) -> None:
        self._reference = make_thumbnail(first, STILL_SIDE)
        self._still: list[bool] = []
        corners = cv2.goodFeaturesToTrack(self._reference, MAX_POINTS, 0.01, 4)
        self._is_trackable = corners is not None and len(corners) >= _TRACKABLE

    def add(self, image: GreyImage) -> None:
        """Measures one more frame with texture, unless the camera is already known to move."""
        if not self._is_trackable:
            return
        if self._still.count(False) <= self._still.count(True) + _DECIDED:
            self._still.append(self._matches_reference(make_thumbnail(image, STILL_SIDE)))

    @property
    def is_still(self) -> bool:
        """True where nine frames in ten, and at least one, are in the place of the first."""
        return bool(self._still) and self._still.count(True) >= 0.9 * len(self._still)

    def _matches_reference(self, image: GreyImage) -> bool:
        matched = match_contrast(image, self._reference)
        points, displacements = track_corners(self._reference, matched)
        if len(points) < _TRACKABLE:
            return False
        affine, _ = cv2.estimateAffinePartial2D(points, points + displacements, method=cv2.LMEDS)
        if affine is None:
            return False
        fitted = points @ affine[:, :2].T + affine[:, 2] - points
        scatter_px = float(np.median(np.linalg.norm(displacements - fitted, axis=1)))
        motion_px = float(np.median(np.linalg.norm(fitted, axis=1)))
        return scatter_px < _SHIMMER_PX and motion_px < STILL_PX + scatter_px
