"""Columns fitted to the summed evidence: a shrinking random search from the proposals."""

from collections.abc import Callable

import numpy as np

from geometry.arrays import FloatArray
from locate.fusion.column import HEIGHT, OPENING, RADIUS, SLOPE_X, SLOPE_Y, X, Y, Z, agreed, score
from locate.fusion.proposals import SEPARATION_UNITS
from locate.fusion.views import Views

ROUNDS, DRAWS, SHRINK = 18, 40, 0.87
SURVIVORS_AFTER, SURVIVORS = 7, 8
STEP_UNITS = np.array([0.2, 0.2, 0.2, 0.12, 0.12, 0.5, 0.06, 0.05])
RADIUS_UNITS = (0.05, 0.4)
HEIGHT_UNITS = (0.5, 5.0)
STEEPEST = 0.6
OPENINGS = (0.02, 0.35)
LENGTHS = (X, Y, Z, HEIGHT, RADIUS)


def fit_columns(
    views: Views,
    starts: FloatArray,
    unit: float,
    rng: np.random.Generator,
    *,
    total: Callable[[FloatArray], FloatArray] = agreed,
) -> FloatArray:
    """Refines (N, 8) starts and returns the distinct columns they end in, best first.

    The opening angle stays free: held fixed, the fit slides towards the cameras. What is made
    as large as possible is the `total` over views.
    """
    columns = _clip(starts, unit)
    best = total(score(views, columns))
    scale = np.ones(8)
    scale[list(LENGTHS)] = unit
    for turn in range(ROUNDS):
        step = STEP_UNITS * scale * SHRINK**turn
        tried = np.repeat(columns, DRAWS, axis=0)
        tried = _clip(tried + rng.normal(size=tried.shape) * step, unit)
        value = total(score(views, tried)).reshape(len(columns), DRAWS)
        pick = value.argmax(axis=1)
        rows = np.arange(len(columns))
        better = value[rows, pick] > best
        columns[better] = tried.reshape(len(columns), DRAWS, 8)[rows, pick][better]
        best = np.maximum(best, value.max(axis=1))
        if turn == SURVIVORS_AFTER:
            keep = distinct(columns[np.argsort(-best)], unit)[:SURVIVORS]
            columns = keep
            best = total(score(views, columns))
    return distinct(columns[np.argsort(-best)], unit)


def _clip(columns: FloatArray, unit: float) -> FloatArray:
    clipped = columns.copy()
    clipped[:, [SLOPE_X, SLOPE_Y]] = clipped[:, [SLOPE_X, SLOPE_Y]].clip(-STEEPEST, STEEPEST)
    clipped[:, HEIGHT] = clipped[:, HEIGHT].clip(*np.multiply(HEIGHT_UNITS, unit))
    clipped[:, RADIUS] = clipped[:, RADIUS].clip(*np.multiply(RADIUS_UNITS, unit))
    clipped[:, OPENING] = clipped[:, OPENING].clip(*OPENINGS)
    return clipped


def distinct(columns: FloatArray, unit: float) -> FloatArray:
    """Drops every column whose axis passes close to that of an earlier, better one.

    Two axes are one plume where they come nearer than `SEPARATION_UNITS` at some height that
    both span.
    """
    kept: list[FloatArray] = []
    for column in columns:
        if all(_distance(column, other) > SEPARATION_UNITS * unit for other in kept):
            kept.append(column)
    return np.reshape(kept, (-1, 8))


def _distance(a: FloatArray, b: FloatArray) -> float:
    """Smallest horizontal distance of two axes over the heights both span, or nearly span."""
    low, high = max(a[Z], b[Z]), min(a[Z] + a[HEIGHT], b[Z] + b[HEIGHT])
    z = np.linspace(min(low, high), max(low, high), 9)[:, None]
    at_a = a[[X, Y]] + a[[SLOPE_X, SLOPE_Y]] * (z - a[Z])
    at_b = b[[X, Y]] + b[[SLOPE_X, SLOPE_Y]] * (z - b[Z])
    return float(np.linalg.norm(at_a - at_b, axis=1).min())
