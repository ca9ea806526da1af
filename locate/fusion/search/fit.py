"""Columns fitted to the summed evidence: a shrinking random search."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from geometry.arrays import FloatArray
from locate.fusion.search.columns import (
    HEIGHT,
    RADIUS,
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
FREE = (-np.inf, np.inf)
"""No bounds."""
SEARCH_GAIN = 2.0
"""So many times the evidence of a column a search from it may still find; chosen by hand."""


@dataclass(frozen=True, kw_only=True, eq=False)
class SearchSpace:
    """Which columns a search tries: lengths in units of fusion, slopes and openings as they are.

    Attributes:
        steps: (8,) standard deviations of a step of the first round, for each entry of a column.
        bounds: (8, 2) least and largest value of each entry.
        shrink: How the steps shrink from round to round.
    """

    steps: FloatArray
    bounds: FloatArray
    shrink: float

    def steps_in(self, unit: float) -> FloatArray:
        """(8,) how far the first round tries to either side, lengths in world units."""
        return np.asarray(self.steps * _scale(unit))

    def clip(self, columns: FloatArray, unit: float) -> FloatArray:
        """The nearest (N, 8) columns within the bounds."""
        least, most = self.bounds.T * _scale(unit)
        return np.asarray(columns.clip(least, most))


def _scale(unit: float) -> FloatArray:
    """(8,) what each entry of a column is counted in."""
    scale = np.ones(8)
    scale[list(LENGTHS)] = unit
    return scale


SLOPES = (-STEEPEST, STEEPEST)
"""Least and largest slope of an axis."""
PLUMES = SearchSpace(
    steps=SEARCH_STEP_UNITS,
    bounds=np.array([FREE, FREE, FREE, SLOPES, SLOPES, HEIGHT_UNITS, RADIUS_UNITS, OPENINGS]),
    shrink=SHRINK,
)
"""Columns that a plume may have."""

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
    space: SearchSpace = PLUMES,
) -> tuple[Columns, FloatArray]:
    """The N columns that N starts end in, each by itself, and their values.

    The opening angle stays free: held fixed, the fit slides towards the cameras. `space` says how
    far it goes.
    """
    columns = space.clip(starts.array, unit)
    best = objective(Columns(columns))
    rows = np.arange(len(columns))
    for round_number in rounds:
        step = space.steps_in(unit) * space.shrink**round_number
        tried = np.repeat(columns, DRAWS, axis=0)
        tried = space.clip(tried + rng.normal(size=tried.shape) * step, unit)
        value = objective(Columns(tried)).reshape(len(columns), DRAWS)
        pick = value.argmax(axis=1)
        better = value[rows, pick] > best
        columns[better] = tried.reshape(len(columns), DRAWS, 8)[rows, pick][better]
        best = np.maximum(best, value.max(axis=1))
    return Columns(columns), best


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
