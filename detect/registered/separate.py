"""Refraction and parallax told apart: depth turns its sign with the baseline, refraction does not.

Towards neighbour k a pixel's residual flow is e_k = slope_k * step + w (- w_k, which the many
neighbours average away), with `step` the error of its inverse depth and w its displacement.
"""

from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from geometry.arrays import FloatMap

ComplexMap: TypeAlias = NDArray[np.complex64]

TINY = np.float32(1e-6)
STEP_STIFFNESS_PX2 = np.float32(1e-2)


@dataclass(frozen=True, kw_only=True)
class Separation:
    """The weighted least-squares answer at every pixel.

    Attributes:
        inverse_depth_step: (H, W) what to add to the relative inverse depth.
        displacement: (H, W, 2) w, px.
        squared_residuals: (N, H, W) what neither explains, px squared.
        variance_factor: (H, W) variance of a component of w for residuals of unit variance.
    """

    inverse_depth_step: FloatMap
    displacement: FloatMap
    squared_residuals: FloatMap
    variance_factor: FloatMap


def separate(flows: FloatMap, slopes: FloatMap, weights: FloatMap) -> Separation:
    """Solves e_k = slope_k * step + w at every pixel.

    Args:
        flows: (N, H, W, 2) residual flow towards each neighbour, px.
        slopes: (N, H, W, 2) px per unit of relative inverse depth.
        weights: (N, H, W) from 0 to 1.
    """
    flow, slope = as_complex(flows), as_complex(slopes)
    total = weights.sum(axis=0) + TINY
    mean_slope = (weights * slope).sum(axis=0) / total
    mean_flow = (weights * flow).sum(axis=0) / total
    spread, along = np.full_like(total, STEP_STIFFNESS_PX2), np.zeros_like(total)
    for k, weight in enumerate(weights):
        leverage = slope[k] - mean_slope
        spread += weight * dot(leverage, leverage)
        along += weight * dot(leverage, flow[k] - mean_flow)
    step = along / spread
    displacement = mean_flow - mean_slope * step
    return Separation(
        inverse_depth_step=step,
        displacement=as_field(displacement),
        squared_residuals=np.stack(
            [squared(flow[k] - slope[k] * step - displacement) for k in range(len(weights))]
        ),
        variance_factor=1 / total + squared(mean_slope) / (2 * spread),
    )


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


def pose_like_field(
    field: FloatMap, inverse_depth: FloatMap, weights: FloatMap, *, stride: int = 4
) -> FloatMap:
    """What a small pose error would look like, fitted robustly.

    A turn of the camera moves pixels by a quadratic in their position, a shift by inverse depth
    times a linear function (Longuet-Higgins & Prazdny, Proc. R. Soc. B 1980, eq. 2.11 and 2.12).

    Args:
        field: (H, W, 2) px.
        inverse_depth: (H, W) in any unit.
        weights: (H, W) from 0 to 1.
        stride: Only every so many rows and columns enter the fit.

    Returns:
        (H, W, 2) px; zero where too little of the image has weight.
    """
    terms = _pose_terms(inverse_depth)
    sparse = (slice(stride // 2, None, stride),) * 2
    count = terms.shape[-1]
    design = terms[sparse].reshape(-1, count).astype(float)
    values = field[sparse].reshape(-1, 2).astype(float)
    prior = weights[sparse].ravel().astype(float)
    if (prior > 0.1).sum() < 10 * count:
        return np.zeros_like(field)
    robust = prior
    for _ in range(4):
        weighted = design * robust[:, None]
        normal = weighted.T @ design + 1e-3 * np.eye(count)
        coefficients = np.linalg.solve(normal, weighted.T @ values)
        misfit = np.linalg.norm(values - design @ coefficients, axis=1)
        scale = max(1.8 * float(np.median(misfit[prior > 0.1])), 0.015)
        robust = prior / (1 + (misfit / scale) ** 2)
    return np.asarray(terms @ coefficients.astype(np.float32))


def _pose_terms(inverse_depth: FloatMap) -> FloatMap:
    sides = (np.linspace(-0.5, 0.5, n, dtype=np.float32) for n in inverse_depth.shape)
    y, x = np.meshgrid(*sides, indexing="ij")
    r = inverse_depth
    return np.stack([np.ones_like(x), x, y, x * x, y * y, x * y, r, r * x, r * y], axis=-1)
