"""Columns fitted to the summed evidence: a shrinking random search."""

from collections.abc import Callable

import numpy as np

from geometry.arrays import FloatArray
from locate.fusion.search.columns import (
    HEIGHT,
    OPENING,
    RADIUS,
    SLOPE_X,
    SLOPE_Y,
    Columns,
    PlumeColumn,
    X,
    Y,
    Z,
)
from locate.fusion.search.proposals import SEPARATION_UNITS

ALL_ROUNDS = range(18)
"""Rounds of a whole search; chosen by hand."""
COARSE_ROUNDS, FINE_ROUNDS = ALL_ROUNDS[:8], ALL_ROUNDS[8:]
"""Before and after near duplicates are dropped; chosen by hand."""
DRAWS, SHRINK = 40, 0.87
"""Columns tried per column and round, and how the steps shrink from round to round; by hand."""
SURVIVORS = 8
"""Columns that the fine rounds go on with; chosen by hand."""
SEARCH_STEP_UNITS = np.array([0.2, 0.2, 0.2, 0.12, 0.12, 0.5, 0.06, 0.05])
"""Standard deviation of a step of the first round, for each entry of a column: lengths in units of
fusion, slopes and opening as they are; chosen by hand."""
RADIUS_UNITS = (0.05, 0.4)
"""Least and largest radius of a plume at its lowest point, units of fusion; chosen by hand."""
HEIGHT_UNITS = (0.5, 5.0)
"""Least and largest height, units of fusion; chosen by hand."""
STEEPEST = 0.6
"""Largest slope of an axis along X or Y, horizontal per vertical; chosen by hand."""
OPENINGS = (0.02, 0.35)
"""Least and largest growth of the radius per unit of height; chosen by hand."""
LENGTHS = (X, Y, Z, HEIGHT, RADIUS)
"""The entries of a column that are lengths."""

Objective = Callable[[Columns], FloatArray]
"""What a search makes as large as possible: (N,) values of N columns."""


def fit_columns(
    objective: Objective, starts: Columns, unit: float, rng: np.random.Generator
) -> Columns:
    """The distinct columns that the starts end in, best first.

    Those that end close to a better one are left out already after the first coarse rounds.

    Args:
        objective: What is made as large as possible.
        starts: Where the search begins.
        unit: Of fusion (`Views.unit`), world units.
        rng: Of the search.
    """
    columns, value = random_search(objective, starts, unit, rng, rounds=COARSE_ROUNDS)
    columns = drop_duplicates(columns.take(np.argsort(-value)), unit).take(slice(SURVIVORS))
    columns, value = random_search(objective, columns, unit, rng, rounds=FINE_ROUNDS)
    return drop_duplicates(columns.take(np.argsort(-value)), unit)


def random_search(
    objective: Objective,
    starts: Columns,
    unit: float,
    rng: np.random.Generator,
    *,
    rounds: range = ALL_ROUNDS,
) -> tuple[Columns, FloatArray]:
    """The N columns that N starts end in, each by itself, and their values.

    The opening angle stays free: held fixed, the fit slides towards the cameras.
    """
    columns = clip_to_bounds(starts.array, unit)
    best = objective(Columns(columns))
    rows = np.arange(len(columns))
    for round_number in rounds:
        step = search_steps(unit) * SHRINK**round_number
        tried = np.repeat(columns, DRAWS, axis=0)
        tried = clip_to_bounds(tried + rng.normal(size=tried.shape) * step, unit)
        value = objective(Columns(tried)).reshape(len(columns), DRAWS)
        pick = value.argmax(axis=1)
        better = value[rows, pick] > best
        columns[better] = tried.reshape(len(columns), DRAWS, 8)[rows, pick][better]
        best = np.maximum(best, value.max(axis=1))
    return Columns(columns), best


def search_steps(unit: float) -> FloatArray:
    """(8,) how far the first round of a search tries to either side."""
    scale = np.ones(8)
    scale[list(LENGTHS)] = unit
    return np.asarray(SEARCH_STEP_UNITS * scale)


def clip_to_bounds(columns: FloatArray, unit: float) -> FloatArray:
    """The nearest (N, 8) columns that a plume may have."""
    near = columns.copy()
    near[:, [SLOPE_X, SLOPE_Y]] = near[:, [SLOPE_X, SLOPE_Y]].clip(-STEEPEST, STEEPEST)
    near[:, HEIGHT] = near[:, HEIGHT].clip(*np.multiply(HEIGHT_UNITS, unit))
    near[:, RADIUS] = near[:, RADIUS].clip(*np.multiply(RADIUS_UNITS, unit))
    near[:, OPENING] = near[:, OPENING].clip(*OPENINGS)
    return near


def drop_duplicates(columns: Columns, unit: float) -> Columns:
    """Drops every column whose axis passes close to that of an earlier, better one.

    Two axes are one plume where they come nearer than `SEPARATION_UNITS` at some height that
    both span.
    """
    kept: list[PlumeColumn] = []
    for column in columns:
        if all(column.gap_to(other) > SEPARATION_UNITS * unit for other in kept):
            kept.append(column)
    return Columns.of(kept)
