"""Normal equations of the displacement, by registered neighbours.

The grey value of neighbour k at a pixel differs from the key frame's by ``g . (slope_k step + w)``,
with g the gradient. Neighbours on both sides of the path separate the inverse depth's error `step`
from the displacement w, pixel by pixel; what is left is one number, ``g . w``. It is not divided by
the gradient: pixels with little texture hold little information, and are weighted by that.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Self

import cv2
import numpy as np

from detect.information import MAP_WIDTH_PX, DisplacementInformation
from detect.registered.separation import MOST_ONE_SIDED, TINY, one_sidedness, row_bands
from detect.warp import blur
from geometry.arrays import FloatMap

BRIGHTNESS_PX = 5.0
"""Standard deviation of what counts as a change of brightness, px."""
COMMON_SHARE = 0.05
"""Standard deviation of what counts as an error of registration, in widths of the frame."""
SCATTER_PX = 2.0
"""Standard deviation of the window that the noise is taken from, px; chosen by hand."""
NEIGHBOUR_PX = 3.0
"""Standard deviation of the window that the error of one neighbour is taken from, px."""
BLURRED = 2.0
"""Mean squared gradient at half the size over that at full size, from which on frames count as
blurred: 4 where half the size loses no detail, 1 in white noise. A handheld recording has 2.6,
simulated plants 1.3 to 1.7 (docs/weak_plumes.md)."""
COMMON_GRADIENTS_PERCENT = 95
"""Gradients are clipped at this percentile for that, so that a few edges do not decide."""
LEAST_VARIANCE = 0.5
"""Of the noise, grey levels squared: 8-bit frames have a twelfth by rounding alone."""
STEP_STIFFNESS = 1.0
"""Keeps the depth where no neighbour shows it, squared grey levels per unit of inverse depth."""
MODEL_ERROR_PX = 0.05
"""What interpolation leaves in a displacement, px: strong edges do not count for more than that."""
EDGE_ERROR_SHARE = 0.2
"""Error by a wrong depth, per px by which parallax varies round a pixel; chosen by hand."""
MOST_PX = 0.7
"""Displacement from which on a pixel loses weight: thin things with the depth of what is behind
them look displaced by more; chosen by hand."""
SLOPE_TAPS = np.array([1, -8, 0, 8, -1], np.float32) / 12
"""Of the slope along a line of pixels: the central difference of fourth order. A Scharr operator
reads fine detail as flatter than it is, so that displacements there seem larger."""
ENOUGH_NEIGHBOURS = 0.5
"""Share of the neighbours that must see a pixel; chosen by hand."""


@dataclass(frozen=True, kw_only=True)
class RegisteredFrames:
    """A key frame and N neighbours brought onto it by poses and depth.

    Attributes:
        key: (H, W) the key frame, grey levels.
        neighbours: (N, H, W) grey levels.
        slopes: (N, 2, H, W) px per unit of inverse depth.
        visible: (N, H, W) where each is seen, 0 or 1.
        depth_edge_px: (H, W) by how much parallax varies between a pixel and its surroundings.
    """

    key: FloatMap
    neighbours: FloatMap
    slopes: FloatMap
    visible: FloatMap
    depth_edge_px: FloatMap

    @cached_property
    def mean(self) -> FloatMap:
        """(H, W) of all frames; the gradient of one alone holds that frame's own noise."""
        total = self.key + self.neighbours.sum(axis=0)
        return np.asarray(total / np.float32(1 + len(self.neighbours)))

    @property
    def blurred(self) -> bool:
        """Whether half the size would show the same detail."""
        return is_blurred([self.mean])

    def halved(self) -> Self:
        """The same at half the size, in px of that size."""
        return type(self)(
            key=halve(self.key),
            neighbours=np.stack([halve(image) for image in self.neighbours]),
            slopes=np.stack([[halve(part) / 2 for part in slope] for slope in self.slopes]),
            visible=np.stack([np.round(halve(seen)) for seen in self.visible]),
            depth_edge_px=halve(self.depth_edge_px / np.float32(2)),
        )


def displacement_information(frames: RegisteredFrames) -> DisplacementInformation:
    """The information of one key frame, on at most `MAP_WIDTH_PX` cells along its width.

    Blurred frames are measured at half their size: the finest pixels hold noise and no detail, and
    a neighbour that lies half a pixel wrong there loses much of the displacement. Small frames are
    measured as they are, as half of one would not fill the cells.
    """
    if frames.key.shape[1] >= 2 * MAP_WIDTH_PX and frames.blurred:
        return sum_pixels(measure_pixels(frames.halved())).in_units_of(2.0)
    return sum_pixels(measure_pixels(frames))


def measure_pixels(frames: RegisteredFrames) -> DisplacementInformation:
    """The information of each pixel, displacements in px of these frames."""
    equations = _PixelEquations.of(frames)
    noise, squares = equations.measure_noise()
    along_x, along_y = equations.along_x, equations.along_y
    steepness = along_x * along_x + along_y * along_y
    error_px2 = MODEL_ERROR_PX**2 + (EDGE_ERROR_SHARE * frames.depth_edge_px) ** 2
    common, precision = np.empty((2, *steepness.shape), np.float32)
    for rows in row_bands(len(steepness)):
        usual = 4 * (noise[rows] + LEAST_VARIANCE)
        weights = np.asarray(equations.trust[:, rows] / (1 + squares[:, rows] / usual), np.float32)
        levers = equations.levers(rows)
        answer = _PixelFit.solve(equations.differences[:, rows], levers, weights)
        common[rows] = -answer.common
        variance = noise[rows] * (1 + answer.variance_factor) + LEAST_VARIANCE
        variance += steepness[rows] * error_px2[rows]
        seen = frames.visible[:, rows].sum(axis=0)
        enough = seen >= max(2, ENOUGH_NEIGHBOURS * len(frames.visible))
        one_sided = one_sidedness(levers[:, None], weights, np.float32(STEP_STIFFNESS))
        enough &= one_sided < MOST_ONE_SIDED
        precision[rows] = enough / variance
    precision /= 1 + (common * common / (steepness + 1) / MOST_PX**2) ** 2
    weighted_x, weighted_y = precision * along_x, precision * along_y
    return DisplacementInformation(
        vector=cv2.merge([weighted_x * common, weighted_y * common]),
        matrix=cv2.merge([weighted_x * along_x, weighted_x * along_y, weighted_y * along_y]),
    )


def sum_pixels(pixels: DisplacementInformation) -> DisplacementInformation:
    """The information of all pixels of a frame, on at most `MAP_WIDTH_PX` cells along its width."""
    height, width = pixels.matrix.shape[:2]
    factor = min(1.0, MAP_WIDTH_PX / width)
    columns, lines = round(width * factor), round(height * factor)
    return pixels.summed_to(columns, lines).without_local_mean(COMMON_SHARE * columns)


def is_blurred(images: Sequence[FloatMap]) -> bool:
    """Whether half the size would show the same detail of an image, of which these are parts."""
    steep = sum(_usual_steepness(image) for image in images)
    return sum(_usual_steepness(halve(image)) for image in images) > BLURRED * steep


def _neighbour_trust(differences: FloatMap) -> FloatMap:
    """(N, H, W) weight of each neighbour at each pixel, 1 of the best: far ones err by more.

    Args:
        differences: (N, H, W) from the key frame, grey levels.
    """
    errors = np.stack([blur(each * each, NEIGHBOUR_PX) for each in differences])
    errors += np.float32(LEAST_VARIANCE)
    return np.asarray(errors.min(axis=0) / errors)


def _usual_steepness(image: FloatMap) -> float:
    """Mean squared gradient, those of a few strong edges clipped."""
    along_x, along_y = _slopes(image)
    squares = along_x * along_x + along_y * along_y
    return float(np.minimum(squares, np.percentile(squares, COMMON_GRADIENTS_PERCENT)).mean())


def _slopes(image: FloatMap) -> tuple[FloatMap, FloatMap]:
    """The slopes along x and y, grey levels per px."""
    one, border = np.ones(1, np.float32), cv2.BORDER_REPLICATE
    along_x = cv2.sepFilter2D(image, -1, SLOPE_TAPS, one, borderType=border)
    along_y = cv2.sepFilter2D(image, -1, one, SLOPE_TAPS, borderType=border)
    return np.asarray(along_x), np.asarray(along_y)


def halve(image: FloatMap) -> FloatMap:
    """The image at half its size."""
    height, width = image.shape
    return np.asarray(cv2.resize(image, (width // 2, height // 2), interpolation=cv2.INTER_AREA))


def _blur_wide(image: FloatMap, sigma_px: float) -> FloatMap:
    """A wide Gaussian blur, computed on fewer pixels."""
    shrink = max(1, int(sigma_px // 4))
    size = (max(1, image.shape[1] // shrink), max(1, image.shape[0] // shrink))
    small = cv2.resize(image, size, interpolation=cv2.INTER_AREA)
    smooth = cv2.GaussianBlur(small, (0, 0), sigma_px / shrink)
    return np.asarray(cv2.resize(smooth, image.shape[::-1], interpolation=cv2.INTER_LINEAR))


@dataclass(frozen=True, kw_only=True)
class _PixelEquations:
    """What N neighbours differ by at (H, W) pixels, and what explains it.

    Attributes:
        differences: (N, H, W) from the key frame, changes of brightness taken out, grey levels.
        along_x: (H, W) slope of the mean frame along x, grey levels per px.
        along_y: (H, W) along y.
        slopes: (N, 2, H, W) px per unit of inverse depth.
        trust: (N, H, W) from 0 to 1.
    """

    differences: FloatMap
    along_x: FloatMap
    along_y: FloatMap
    slopes: FloatMap
    trust: FloatMap

    @classmethod
    def of(cls, frames: RegisteredFrames) -> Self:
        """Those of registered frames."""
        differences = frames.neighbours - frames.key
        for k, difference in enumerate(differences):
            differences[k] = difference - _blur_wide(difference, BRIGHTNESS_PX)
        along_x, along_y = _slopes(frames.mean)
        return cls(
            differences=differences,
            along_x=along_x,
            along_y=along_y,
            slopes=frames.slopes,
            trust=frames.visible * _neighbour_trust(differences),
        )

    def levers(self, rows: slice) -> FloatMap:
        """(N, h, W) grey levels per unit of inverse depth, of some rows."""
        along_x, along_y = self.along_x[rows], self.along_y[rows]
        return np.asarray(along_x * self.slopes[:, 0, rows] + along_y * self.slopes[:, 1, rows])

    def measure_noise(self) -> tuple[FloatMap, FloatMap]:
        """(H, W) variance round each pixel, and (N, H, W) weighted squared residuals of a fit."""
        scatter, weight = np.empty((2, *self.along_x.shape), np.float32)
        squares = np.empty_like(self.differences)
        for rows in row_bands(len(scatter)):
            trust = self.trust[:, rows]
            fit = _PixelFit.solve(self.differences[:, rows], self.levers(rows), trust)
            scatter[rows], weight[rows] = fit.scatter, fit.weights.sum(axis=0)
            squares[:, rows] = trust * fit.squared_residuals
        freedom = np.maximum(blur(weight, SCATTER_PX) - 2, 1)
        return np.asarray(blur(scatter, SCATTER_PX) / freedom, np.float32), squares


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
