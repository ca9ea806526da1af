"""Separation that a few bad neighbours do not spoil."""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from detect.registered.separation import (
    STEP_STIFFNESS_PX2,
    TINY,
    Separation,
    one_sidedness,
    separate_parallax,
)
from geometry.arrays import FloatMap


@dataclass(frozen=True, kw_only=True)
class RegisteredNeighbours:
    """N neighbours brought onto the key frame.

    Attributes:
        images: (N, H, W) grey levels.
        flows: (N, 2, H, W) from the key frame into each, as they were brought, px.
        shifts: (N, 2, H, W) how far they still are from it, px.
        slopes: (N, 2, H, W) px per unit of relative inverse depth.
        visible: (N, H, W) where each is seen, 0 or 1.
        misfits: (N, H, W) squared differences, grey levels squared.
    """

    images: FloatMap
    flows: FloatMap
    shifts: FloatMap
    slopes: FloatMap
    visible: FloatMap
    misfits: FloatMap


@dataclass(frozen=True, kw_only=True)
class RobustSeparation:
    """The answer without outliers.

    Attributes:
        answer: Of some rows.
        variance: (H, W) of the residuals.
        seen: (H, W) weight that was left.
        one_sidedness: (H, W) as of the function of that name.
    """

    answer: Separation
    variance: FloatMap
    seen: FloatMap
    one_sidedness: FloatMap


def separate_robust(
    registered: RegisteredNeighbours, misfit: FloatMap, rows: slice
) -> RobustSeparation:
    """Separates some rows twice, the second time without outliers."""
    shifts, slopes = registered.shifts[:, :, rows], registered.slopes[:, :, rows]
    weights = registered.visible[:, rows] / (1 + (registered.misfits[:, rows] / misfit) ** 2)
    answer, squares, variance = _separate_weighted(shifts, slopes, weights)
    weights /= 1 + squares / (4 * variance + 1e-4)
    answer, _, variance = _separate_weighted(shifts, slopes, weights)
    return RobustSeparation(
        answer=answer,
        variance=variance,
        seen=weights.sum(axis=0),
        one_sidedness=one_sidedness(slopes, weights, STEP_STIFFNESS_PX2),
    )


def _separate_weighted(
    shifts: FloatMap, slopes: FloatMap, weights: FloatMap
) -> tuple[Separation, FloatMap, FloatMap]:
    """The answer, (N, H, W) its squared residuals, and (H, W) their weighted mean."""
    answer = separate_parallax(shifts, slopes, weights)
    squares = answer.squared_residuals(shifts, slopes)
    scatter = np.einsum("nij,nij->ij", weights, squares)
    return answer, squares, scatter / (weights.sum(axis=0) + TINY)


def median_map(maps: Iterable[FloatMap]) -> FloatMap:
    """(H, W) the median of a few maps, by odd-even transposition: whole maps are compared."""
    ranks = list(maps)
    for turn in range(len(ranks)):
        for low in range(turn % 2, len(ranks) - 1, 2):
            a, b = ranks[low : low + 2]
            ranks[low : low + 2] = np.minimum(a, b), np.maximum(a, b)
    half = len(ranks) // 2
    middle = ranks[half] if len(ranks) % 2 else (ranks[half - 1] + ranks[half]) / 2
    return np.asarray(middle)
