"""Columns moved and bent until the displacement turns about them most."""

from dataclasses import dataclass

import numpy as np

from geometry.arrays import FloatArray
from locate.fusion.matched.score import TurnScore
from locate.fusion.search.columns import (
    HEIGHT,
    OPENING,
    RADIUS,
    SLOPE_X,
    SLOPE_Y,
    Columns,
    PlumeColumn,
)
from locate.fusion.search.fit import LENGTHS, STEEPEST

REFINED = 32
"""Columns that are refined, the best of the scan; chosen by hand."""
ROUNDS, DRAWS, SHRINK = 12, 40, 0.8
"""Of the search, columns tried in each, and how the steps shrink; chosen by hand."""
STEP_UNITS = np.array([0.1, 0.1, 0.3, 0.1, 0.1, 0.4, 0.05, 0.04])
"""Standard deviation of a step of the first round, for each entry of a column: lengths in units of
fusion, slopes and opening as they are; chosen by hand."""
WIDTH_UNITS = (0.04, 0.4)
"""Least and largest distance from the axis to the largest displacement, units of fusion."""
HEIGHT_UNITS = (0.5, 4.0)
"""Least and largest height, units of fusion; chosen by hand."""
WIDEST_OPENING = 0.25
"""Growth of the width per unit of height; chosen by hand."""
APART_UNITS = 0.3
"""Axes nearer than this are one plume's, units of fusion; chosen by hand."""


@dataclass(frozen=True, eq=False)
class Turn:
    """A column about which the displacement turns.

    Attributes:
        column: Its radius is the distance from the axis to the largest displacement.
        sigmas: How surely; positive where light is bent away from the axis.
    """

    column: PlumeColumn
    sigmas: float


def find_turns(score: TurnScore, proposals: Columns, rng: np.random.Generator) -> list[Turn]:
    """The distinct columns that the best proposals end in, the surest first.

    Args:
        score: What is made as large as possible.
        proposals: Where the search begins.
        rng: Of the search.
    """
    unit = score.filters.views.unit
    first = score(proposals)
    best = np.argsort(-np.abs(first), kind="stable")[:REFINED]
    columns, sigmas = _climb(score, proposals.take(best), first[best], rng)
    found: list[Turn] = []
    for k in np.argsort(-np.abs(sigmas), kind="stable"):
        column = columns[k]
        if all(column.gap_to(other.column) > APART_UNITS * unit for other in found):
            found.append(Turn(column, float(sigmas[k])))
    return found


def _climb(
    score: TurnScore, starts: Columns, sigmas: FloatArray, rng: np.random.Generator
) -> tuple[Columns, FloatArray]:
    """Where N starts end, each by itself, and their sigmas; which way light is bent is kept."""
    unit = score.filters.views.unit
    columns = _clip_to_bounds(starts.array, unit)
    sign = np.where(sigmas < 0, -1.0, 1.0)
    best = sign * score(Columns(columns))
    rows = np.arange(len(columns))
    scale = np.ones(8)
    scale[list(LENGTHS)] = unit
    for turn in range(ROUNDS):
        step = STEP_UNITS * scale * SHRINK**turn
        tried = np.repeat(columns, DRAWS, axis=0)
        tried = _clip_to_bounds(tried + rng.normal(size=tried.shape) * step, unit)
        value = score(Columns(tried)).reshape(len(columns), DRAWS) * sign[:, None]
        pick = value.argmax(axis=1)
        better = value[rows, pick] > best
        columns[better] = tried.reshape(len(columns), DRAWS, 8)[rows, pick][better]
        best = np.maximum(best, value.max(axis=1))
    return Columns(columns), sign * best


def _clip_to_bounds(columns: FloatArray, unit: float) -> FloatArray:
    near = columns.copy()
    near[:, [SLOPE_X, SLOPE_Y]] = near[:, [SLOPE_X, SLOPE_Y]].clip(-STEEPEST, STEEPEST)
    near[:, HEIGHT] = near[:, HEIGHT].clip(*np.multiply(HEIGHT_UNITS, unit))
    near[:, RADIUS] = near[:, RADIUS].clip(*np.multiply(WIDTH_UNITS, unit))
    near[:, OPENING] = near[:, OPENING].clip(0, WIDEST_OPENING)
    return near
