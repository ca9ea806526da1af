"""Refraction and parallax told apart: depth turns its sign with the baseline, refraction does not.

Towards neighbour k a pixel's residual flow is e_k = slope_k * step + w (- w_k, which the many
neighbours average away), with `step` the error of its inverse depth and w its displacement.
Vector fields are (2, H, W) here, x and y in planes of their own: the quickest for numpy.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from geometry.arrays import FloatMap

TINY = np.float32(1e-6)
STEP_STIFFNESS_PX2 = np.float32(1e-2)
BAND = 16


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

    def squared_residual(self, flow: FloatMap, slope: FloatMap) -> FloatMap:
        """(H, W) what neither explains of one neighbour's flow, px squared."""
        return squared(flow - slope * self.inverse_depth_step - self.displacement)


def separate(
    flows: Sequence[FloatMap], slopes: Sequence[FloatMap], weights: Sequence[FloatMap]
) -> Separation:
    """Solves e_k = slope_k * step + w at every pixel.

    Args:
        flows: N of (2, H, W), residual flow towards each neighbour, px.
        slopes: N of (2, H, W), px per unit of relative inverse depth.
        weights: N of (H, W), from 0 to 1.
    """
    total = np.full_like(weights[0], TINY)
    mean_slope, mean_flow = np.zeros((2, *slopes[0].shape), np.float32)
    for flow, slope, weight in zip(flows, slopes, weights, strict=True):
        total += weight
        mean_slope += weight * slope
        mean_flow += weight * flow
    mean_slope /= total
    mean_flow /= total
    spread, along = np.full_like(total, STEP_STIFFNESS_PX2), np.zeros_like(total)
    for flow, slope, weight in zip(flows, slopes, weights, strict=True):
        leverage = slope - mean_slope
        weighted = weight * leverage
        spread += dot(weighted, leverage)
        along += dot(weighted, flow - mean_flow)
    step = along / spread
    return Separation(
        inverse_depth_step=step,
        displacement=mean_flow - mean_slope * step,
        variance_factor=1 / total + squared(mean_slope) / (2 * spread),
    )


def bands(height: int) -> Iterator[slice]:
    """The rows of an image some at a time: what is done to a few stays in the cache."""
    return (slice(start, start + BAND) for start in range(0, height, BAND))


def dot(a: FloatMap, b: FloatMap) -> FloatMap:
    """(H, W) the scalar product of two vector fields."""
    return np.asarray(a[0] * b[0] + a[1] * b[1])


def squared(a: FloatMap) -> FloatMap:
    """(H, W) the squared length of a vector field."""
    return dot(a, a)
