"""Refraction and parallax separated: depth turns its sign with the baseline, refraction does not.

Towards neighbour k a pixel's residual flow is e_k = slope_k * step + w (- w_k, which the many
neighbours average away), with `step` the error of its inverse depth and w its displacement.
Vector fields are (2, H, W) here, x and y in planes of their own: the quickest for numpy.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from geometry.arrays import FloatMap

TINY = np.float32(1e-6)
"""Added to sums of weights that are divided by."""
STEP_STIFFNESS_PX2 = np.float32(1e-2)
"""Keeps the inverse depth where slopes hardly differ, px squared per squared unit of it."""
MOST_ONE_SIDED = 2.0
"""One-sidedness from which on a pixel is left out: displacements are systematically wrong by up to
0.1 px beyond (docs/weak_plumes.md). Set on three recordings."""
BAND = 32
"""Rows that are computed at a time."""
MEAN, SUM = "nij,ncij->cij", "ncij,ncij->ij"


@dataclass(frozen=True, kw_only=True)
class Separation:
    """The weighted least-squares answer at every pixel.

    Attributes:
        inverse_depth_step: (H, W) what to add to the relative inverse depth.
        displacement: (2, H, W) w, px.
        variance_factor: (H, W) variance of a component of w for residuals of unit variance.
    """

    inverse_depth_step: FloatMap
    displacement: FloatMap
    variance_factor: FloatMap

    def squared_residuals(self, flows: FloatMap, slopes: FloatMap) -> FloatMap:
        """(N, H, W) what neither explains of the flow towards each neighbour, px squared."""
        explained = slopes * self.inverse_depth_step
        explained += self.displacement
        explained -= flows
        return squared_length(explained)


def separate_parallax(flows: FloatMap, slopes: FloatMap, weights: FloatMap) -> Separation:
    """Solves e_k = slope_k * step + w at every pixel.

    Leverages, slopes less their mean, add up to zero with their weights: what they are summed
    with keeps its mean.

    Args:
        flows: (N, 2, H, W) residual flow towards each neighbour, px.
        slopes: (N, 2, H, W) px per unit of relative inverse depth.
        weights: (N, H, W) from 0 to 1.
    """
    total = weights.sum(axis=0) + TINY
    mean_slope, mean_flow = (np.einsum(MEAN, weights, each) / total for each in (slopes, flows))
    leverage = slopes - mean_slope
    leverage *= weights[:, None]
    spread = np.einsum(SUM, leverage, slopes) + STEP_STIFFNESS_PX2
    step = np.einsum(SUM, leverage, flows) / spread
    return Separation(
        inverse_depth_step=step,
        displacement=mean_flow - mean_slope * step,
        variance_factor=1 / total + squared_length(mean_slope) / (2 * spread),
    )


def one_sidedness(slopes: FloatMap, weights: FloatMap, stiffness: np.float32) -> FloatMap:
    """(H, W) how many times as uncertain w is as if all neighbours saw a pixel alike.

    Neighbours on both sides of the path have slopes of both signs, and w is what they measure on
    average. Where one side is hidden or out of the frame w is extrapolated, with all errors that
    grow with the slope.

    Args:
        slopes: (N, C, H, W) per unit of relative inverse depth.
        weights: (N, H, W) from 0 to 1.
        stiffness: Of the inverse depth, in squared units of the slopes.
    """
    alike = np.ones_like(weights)
    own, best = (_variance_growth(slopes, each, stiffness) for each in (weights, alike))
    return np.asarray(own / best)


def _variance_growth(slopes: FloatMap, weights: FloatMap, stiffness: np.float32) -> FloatMap:
    """(H, W) variance of w along the slopes over that at the neighbours' mean slope."""
    total = weights.sum(axis=0) + TINY
    mean = np.einsum(MEAN, weights, slopes) / total
    mean_square = np.einsum("nij,ncij,ncij->ij", weights, slopes, slopes) / total
    centred = np.maximum(mean_square - squared_length(mean), 0) + stiffness / total
    return np.asarray(1 + squared_length(mean) / centred)


def row_bands(height: int) -> Iterator[slice]:
    """The rows of an image some at a time: what is done to a few stays in the cache."""
    return (slice(start, start + BAND) for start in range(0, height, BAND))


def dot_product(a: FloatMap, b: FloatMap) -> FloatMap:
    """(..., H, W) the scalar product of vector fields."""
    return np.asarray(np.einsum("...cij,...cij->...ij", a, b))


def squared_length(a: FloatMap) -> FloatMap:
    """(..., H, W) the squared length of vector fields."""
    return dot_product(a, a)
