"""Refraction and parallax told apart: depth turns its sign with the baseline, refraction does not.

Towards neighbour k a pixel's residual flow is e_k = slope_k * step + w (- w_k, which the many
neighbours average away), with `step` the error of its inverse depth and w its displacement.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from geometry.arrays import FloatMap

ComplexMap: TypeAlias = NDArray[np.complex64]

TINY = np.float32(1e-6)
STEP_STIFFNESS_PX2 = np.float32(1e-2)
BAND = 32
STRIDE = 4
"""Every so many rows and columns enter the fit of a pose error; fewer fit it visibly worse."""


@dataclass(frozen=True, kw_only=True)
class Separation:
    """The weighted least-squares answer at every pixel.

    Attributes:
        inverse_depth_step: (H, W) what to add to the relative inverse depth.
        displacement: (H, W, 2) w, px.
        variance_factor: (H, W) variance of a component of w for residuals of unit variance.
    """

    inverse_depth_step: FloatMap
    displacement: FloatMap
    variance_factor: FloatMap

    def squared_residuals(self, flows: FloatMap, slopes: FloatMap) -> FloatMap:
        """(N, H, W) what neither explains of what was separated, px squared."""
        squares = np.empty(flows.shape[:-1], np.float32)
        flow, slope, w = as_complex(flows), as_complex(slopes), as_complex(self.displacement)
        for rows in bands(len(w)):
            step = self.inverse_depth_step[rows]
            for k, square in enumerate(squares):
                square[rows] = squared(flow[k, rows] - slope[k, rows] * step - w[rows])
        return squares


def separate(flows: FloatMap, slopes: FloatMap, weights: FloatMap) -> Separation:
    """Solves e_k = slope_k * step + w at every pixel.

    Args:
        flows: (N, H, W, 2) residual flow towards each neighbour, px.
        slopes: (N, H, W, 2) px per unit of relative inverse depth.
        weights: (N, H, W) from 0 to 1.
    """
    flow, slope = as_complex(flows), as_complex(slopes)
    step, factor = np.empty((2, *flow.shape[1:]), np.float32)
    displacement = np.empty(flow.shape[1:], np.complex64)
    for rows in bands(len(step)):
        step[rows], displacement[rows], factor[rows] = _separate(
            flow[:, rows], slope[:, rows], weights[:, rows]
        )
    return Separation(
        inverse_depth_step=step, displacement=as_field(displacement), variance_factor=factor
    )


def _separate(
    flow: ComplexMap, slope: ComplexMap, weights: FloatMap
) -> tuple[FloatMap, ComplexMap, FloatMap]:
    """The inverse depth's step, the displacement and the variance factor."""
    total = weights.sum(axis=0) + TINY
    mean_slope = (weights * slope).sum(axis=0) / total
    mean_flow = (weights * flow).sum(axis=0) / total
    spread, along = np.full_like(total, STEP_STIFFNESS_PX2), np.zeros_like(total)
    for k, weight in enumerate(weights):
        leverage = slope[k] - mean_slope
        spread += weight * squared(leverage)
        along += weight * dot(leverage, flow[k] - mean_flow)
    step = along / spread
    return (
        step,
        mean_flow - mean_slope * step,
        1 / total + squared(mean_slope) / (2 * spread),
    )


def bands(height: int) -> Iterator[slice]:
    """The rows of an image some at a time: what is done to a few stays in the cache."""
    return (slice(start, start + BAND) for start in range(0, height, BAND))


def as_complex(field: FloatMap) -> ComplexMap:
    """(..., 2) vectors as (...) complex numbers x + iy: the quickest arithmetic numpy has."""
    return np.ascontiguousarray(field, dtype=np.float32).view(np.complex64)[..., 0]


def as_field(numbers: ComplexMap) -> FloatMap:
    """(..., 2) vectors of (...) complex numbers."""
    return np.ascontiguousarray(numbers)[..., None].view(np.float32)


def dot(a: ComplexMap, b: ComplexMap) -> FloatMap:
    """(...) the scalar product of two vector fields."""
    return a.real * b.real + a.imag * b.imag


def squared(a: ComplexMap) -> FloatMap:
    """(...) the squared length of a vector field."""
    return dot(a, a)


def pose_like_field(field: FloatMap, inverse_depth: FloatMap, weights: FloatMap) -> FloatMap:
    """What a small pose error would look like, fitted robustly.

    A turn of the camera moves pixels by a quadratic in their position, a shift by inverse depth
    times a linear function (Longuet-Higgins & Prazdny, Proc. R. Soc. B 1980, eq. 2.11 and 2.12).

    Args:
        field: (H, W, 2) px.
        inverse_depth: (H, W) in any unit.
        weights: (H, W) from 0 to 1.

    Returns:
        (H, W, 2) px; zero where too little of the image has weight.
    """
    y, x = (np.linspace(-0.5, 0.5, n, dtype=np.float32) for n in inverse_depth.shape)
    some = slice(STRIDE // 2, None, STRIDE)
    design = _pose_terms(x[some], y[some], inverse_depth[some, some]).astype(float)
    values = field[some, some].reshape(-1, 2).astype(float)
    prior = weights[some, some].ravel().astype(float)
    if (prior > 0.1).sum() < 10 * design.shape[1]:
        return np.zeros_like(field)
    robust = prior
    for _ in range(4):
        weighted = design * robust[:, None]
        normal = weighted.T @ design + 1e-3 * np.eye(design.shape[1])
        coefficients = np.linalg.solve(normal, weighted.T @ values)
        misfit = np.linalg.norm(values - design @ coefficients, axis=1)
        scale = max(1.8 * float(np.median(misfit[prior > 0.1])), 0.015)
        robust = prior / (1 + (misfit / scale) ** 2)
    found = as_complex(coefficients)
    return as_field(_pose_like(found, x, y[:, None], inverse_depth))


def _pose_terms(x: FloatMap, y: FloatMap, inverse_depth: FloatMap) -> FloatMap:
    """(N, 9) what each coefficient is multiplied by, on the grid of (W,) x and (H,) y."""
    x, y = np.meshgrid(x, y)
    r = inverse_depth
    terms = [np.ones_like(x), x, y, x * x, y * y, x * y, r, r * x, r * y]
    return np.stack([term.ravel() for term in terms], axis=-1)


def _pose_like(c: ComplexMap, x: FloatMap, y: FloatMap, inverse_depth: FloatMap) -> ComplexMap:
    """(H, W) the sum of `_pose_terms` times c, of (W,) x and (H, 1) y."""
    across, along = c[0] + (c[1] + c[3] * x) * x, (c[2] + c[4] * y) * y
    with_depth = inverse_depth * (c[6] + c[7] * x + c[8] * y)
    return np.asarray(across + along + y * (c[5] * x) + with_depth)
