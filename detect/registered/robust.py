"""Separation that a few bad neighbours do not spoil."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from detect.registered.separate import TINY, Separation, separate
from geometry.arrays import FloatMap


@dataclass(frozen=True, kw_only=True)
class Registered:
    """A neighbour brought onto the key frame.

    Attributes:
        shift: (2, H, W) how far it still is from it, px.
        slope: (2, H, W) px per unit of relative inverse depth.
        visible: (H, W) where it is seen, 0 or 1.
        misfit: (H, W) squared difference, grey levels squared.
    """

    shift: FloatMap
    slope: FloatMap
    visible: FloatMap
    misfit: FloatMap


@dataclass(frozen=True, kw_only=True)
class Robust:
    """The answer without outliers, its residual variance, the weight that was left."""

    answer: Separation
    variance: FloatMap
    seen: FloatMap


def robustly(registered: Sequence[Registered], misfit: FloatMap, rows: slice) -> Robust:
    """Separates some rows twice, the second time without outliers."""
    shifts = [r.shift[:, rows] for r in registered]
    slopes = [r.slope[:, rows] for r in registered]
    weights = [r.visible[rows] / (1 + (r.misfit[rows] / misfit) ** 2) for r in registered]
    for last in (False, True):
        answer = separate(shifts, slopes, weights)
        squares = [answer.squared_residual(*pair) for pair in zip(shifts, slopes, strict=True)]
        seen, scatter = np.zeros((2, *misfit.shape), np.float32)
        for weight, square in zip(weights, squares, strict=True):
            seen += weight
            scatter += weight * square
        variance = scatter / (seen + TINY)
        if not last:
            doubt = 4 * variance + 1e-4
            weights = [w / (1 + s / doubt) for w, s in zip(weights, squares, strict=True)]
    return Robust(answer=answer, variance=variance, seen=seen)


def median(maps: Sequence[FloatMap]) -> FloatMap:
    """(H, W) the median of a few maps, by odd-even transposition: whole maps are compared."""
    ranks = list(maps)
    for turn in range(len(ranks)):
        for low in range(turn % 2, len(ranks) - 1, 2):
            a, b = ranks[low : low + 2]
            ranks[low : low + 2] = np.minimum(a, b), np.maximum(a, b)
    half = len(ranks) // 2
    middle = ranks[half] if len(ranks) % 2 else (ranks[half - 1] + ranks[half]) / 2
    return np.asarray(middle)
