"""Frames of another exposure, brought to the brightness of the key frame.

Exposure and a camera's gain multiply all grey levels, also after its tone curve where that is a
power. Beside a frame that is brighter all texture differs, which looks like displacement.
"""

from functools import cache
from typing import Any

import cv2
import numpy as np

from detect.warp import pixel_grid, sample
from geometry.arrays import FloatMap, GreyImage
from geometry.epipolar import EpipolarGeometry

WIDTH_PX = 160
"""Width of the frames that are compared."""
DARKEST, BRIGHTEST = 16, 240
"""Grey levels beyond which a pixel may be clipped, or hold more offset than light."""
ENOUGH = 0.1
"""Share of the pixels that must lie between these."""
LEAST_CHANGE = 0.01
"""Of the brightness, from which on frames count as of another exposure. The ratio is known to
0.003 on simulated plants."""


def gain_towards(key: GreyImage, other: GreyImage, view: EpipolarGeometry) -> float:
    """By what the grey levels of another frame are multiplied to be as those of the key frame.

    The median ratio of the pixels, with the other frame brought onto the key frame by optical flow.

    Args:
        key: (H, W) uint8.
        other: (H, W) uint8 of the same scene.
        view: How pixels of the key frame move into it by relative inverse depth.

    Returns:
        1 where the exposure is the same, or too few pixels show it.
    """
    small, smaller_other = _shrink(key), _shrink(other)
    grid = pixel_grid(small.shape)
    factor = np.divide(key.shape[::-1], small.shape[::-1]).astype(np.float32)
    pixels = np.asarray((grid + 0.5) * factor - 0.5, np.float32)
    predicted = np.asarray(view.flow(pixels, 1.0) / factor, np.float32)
    positions = grid + _matcher().calc(small, smaller_other, predicted)
    moved = sample(smaller_other, positions)
    usable = ((positions >= 0) & (positions <= grid[-1, -1])).all(axis=-1)
    usable &= (np.minimum(small, moved) > DARKEST) & (np.maximum(small, moved) < BRIGHTEST)
    if usable.mean() < ENOUGH:
        return 1.0
    gain = float(np.median(small[usable] / moved[usable]))
    return gain if abs(gain - 1) >= LEAST_CHANGE else 1.0


def brighten(image: GreyImage, gain: float) -> GreyImage:
    """The image with its grey levels multiplied."""
    return image if gain == 1 else np.asarray(cv2.convertScaleAbs(image, alpha=gain))


def brighten_full_size(image: FloatMap, gain: float) -> FloatMap:
    """As `brighten`, of grey levels that are not rounded."""
    return image if gain == 1 else np.asarray(image * np.float32(gain))


@cache
def _matcher() -> Any:
    return cv2.DISOpticalFlow.create(cv2.DISOPTICAL_FLOW_PRESET_ULTRAFAST)


def _shrink(image: GreyImage) -> GreyImage:
    height, width = image.shape
    factor = min(1.0, WIDTH_PX / width)
    size = (round(width * factor), max(1, round(height * factor)))
    return np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA))
