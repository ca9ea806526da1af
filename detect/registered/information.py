"""What registered neighbours tell about the displacement, as normal equations.

The grey value of neighbour k at a pixel differs from the key frame's by ``g . (slope_k step + w)``,
with g the gradient. Neighbours on both sides of the path tell the inverse depth's error `step` from
the displacement w, pixel by pixel; what is left is one number, ``g . w``. It is not divided by the
gradient, so places with little texture lose nothing: they say little, and count as much.
"""

from dataclasses import dataclass
from typing import Self

import cv2
import numpy as np

from detect.information import MAP_WIDTH_PX, DisplacementInformation
from detect.registered.separation import TINY, row_bands
from detect.warp import blur, gradients
from geometry.arrays import FloatMap

BRIGHTNESS_SHARE = 0.025
"""Standard deviation of what counts as a change of brightness, in widths of the frame."""
COMMON_SHARE = 0.05
"""Standard deviation of what counts as an error of registration, in widths of the frame."""
SCATTER_PX = 2.0
"""Standard deviation of the window that the noise is taken from, px; chosen by hand."""
LEAST_VARIANCE = 1.0
"""Of the noise, grey levels squared: 8-bit frames have a twelfth by rounding alone."""
STEP_STIFFNESS = 1.0
"""Keeps the depth where nothing tells it, grey levels squared per unit of inverse depth squared."""
MODEL_ERROR_PX = 0.05
"""What interpolation leaves in a displacement, px: strong edges do not count for more than that."""
EDGE_ERROR_SHARE = 0.2
"""Error by a wrong depth, per px by which parallax varies round a pixel; chosen by hand."""
MOST_PX = 0.7
"""Displacement from which on a pixel loses weight: thin things with the depth of what is behind
them look displaced by more; chosen by hand."""
ENOUGH_NEIGHBOURS = 0.5
"""Share of the neighbours that must see a pixel; chosen by hand."""


def displacement_information(
    key: FloatMap,
    registered: FloatMap,
    slopes: FloatMap,
    visible: FloatMap,
    depth_edge_px: FloatMap,
) -> DisplacementInformation:
    """The information of one key frame, on at most `MAP_WIDTH_PX` cells along its width.

    Args:
        key: (H, W) the key frame, grey levels.
        registered: (N, H, W) its neighbours, each brought onto it by poses and depth.
        slopes: (N, 2, H, W) px per unit of inverse depth.
        visible: (N, H, W) where each is seen, 0 or 1.
        depth_edge_px: (H, W) by how much parallax varies between a pixel and its surroundings.
    """
    height, width = key.shape
    wide = BRIGHTNESS_SHARE * width
    differences = registered - key
    for k, difference in enumerate(differences):
        differences[k] = difference - _blur_wide(difference, wide)
    along_x, along_y = gradients((key + registered.mean(axis=0)) / 2)
    scatter, weight = np.empty((2, height, width), np.float32)
    squares = np.empty_like(differences)
    for rows in row_bands(height):
        lever = _levers(along_x, along_y, slopes, rows)
        first = _PixelFit.solve(differences[:, rows], lever, visible[:, rows])
        scatter[rows], weight[rows] = first.scatter, first.weights.sum(axis=0)
        squares[:, rows] = first.squared_residuals
    freedom = np.maximum(blur(weight, SCATTER_PX) - 2, 1)
    noise = blur(scatter, SCATTER_PX) / freedom
    steepness = along_x * along_x + along_y * along_y
    error_px2 = MODEL_ERROR_PX**2 + (EDGE_ERROR_SHARE * depth_edge_px) ** 2
    told, precision = np.empty((2, height, width), np.float32)
    for rows in row_bands(height):
        lever = _levers(along_x, along_y, slopes, rows)
        calm = 4 * (noise[rows] + LEAST_VARIANCE)
        weights = np.asarray(visible[:, rows] / (1 + squares[:, rows] / calm), np.float32)
        answer = _PixelFit.solve(differences[:, rows], lever, weights)
        told[rows] = -answer.common
        variance = noise[rows] * (1 + answer.variance_factor) + LEAST_VARIANCE
        variance += steepness[rows] * error_px2[rows]
        enough = visible[:, rows].sum(axis=0) >= max(2, ENOUGH_NEIGHBOURS * len(visible))
        precision[rows] = enough / variance
    precision /= 1 + (told * told / (steepness + 1) / MOST_PX**2) ** 2
    weighted_x, weighted_y = precision * along_x, precision * along_y
    information = DisplacementInformation(
        vector=cv2.merge([weighted_x * told, weighted_y * told]),
        matrix=cv2.merge([weighted_x * along_x, weighted_x * along_y, weighted_y * along_y]),
    )
    factor = min(1.0, MAP_WIDTH_PX / width)
    columns, lines = round(width * factor), round(height * factor)
    return information.summed_to(columns, lines).without_local_mean(COMMON_SHARE * columns)


def _levers(along_x: FloatMap, along_y: FloatMap, slopes: FloatMap, rows: slice) -> FloatMap:
    """(N, h, W) grey levels per unit of inverse depth, of some rows."""
    return np.asarray(along_x[rows] * slopes[:, 0, rows] + along_y[rows] * slopes[:, 1, rows])


def _blur_wide(image: FloatMap, sigma_px: float) -> FloatMap:
    """A wide Gaussian blur, computed on fewer pixels."""
    shrink = max(1, int(sigma_px // 4))
    size = (max(1, image.shape[1] // shrink), max(1, image.shape[0] // shrink))
    small = cv2.resize(image, size, interpolation=cv2.INTER_AREA)
    smooth = cv2.GaussianBlur(small, (0, 0), sigma_px / shrink)
    return np.asarray(cv2.resize(smooth, image.shape[::-1], interpolation=cv2.INTER_LINEAR))


@dataclass(frozen=True, kw_only=True)
class _PixelFit:
    """Weighted least squares of ``d_k = lever_k step + common`` at every pixel, (h, W) each.

    Attributes:
        common: What all neighbours share, grey levels.
        variance_factor: Variance of it for differences of unit variance.
        squared_residuals: (N, h, W) what neither explains, grey levels squared.
        weights: (N, h, W) as fitted with.
    """

    common: FloatMap
    variance_factor: FloatMap
    squared_residuals: FloatMap
    weights: FloatMap

    @property
    def scatter(self) -> FloatMap:
        """(h, W) sum of the weighted squared residuals."""
        return np.asarray((self.weights * self.squared_residuals).sum(axis=0))

    @classmethod
    def solve(cls, differences: FloatMap, levers: FloatMap, weights: FloatMap) -> Self:
        """Fits (N, h, W) differences with (N, h, W) weights from 0 to 1."""
        total = weights.sum(axis=0) + TINY
        mean = (weights * differences).sum(axis=0) / total
        mean_lever = (weights * levers).sum(axis=0) / total
        centred = levers - mean_lever
        weighted = weights * centred
        spread = (weighted * levers).sum(axis=0) + np.float32(STEP_STIFFNESS)
        step = (weighted * differences).sum(axis=0) / spread
        residuals = differences - mean - centred * step
        return cls(
            common=mean - mean_lever * step,
            variance_factor=1 / total + mean_lever * mean_lever / spread,
            squared_residuals=residuals * residuals,
            weights=weights,
        )
