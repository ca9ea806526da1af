"""Columns moved and bent until the displacement turns about them most."""

from dataclasses import dataclass

import numpy as np

from geometry.arrays import FloatArray
from locate.fusion.matched.score import TurnScore
from locate.fusion.search.columns import Columns, PlumeColumn
from locate.fusion.search.fit import FREE, SLOPES, SearchSpace, random_search

REFINED = 32
"""Columns that are refined, the best of the scan; chosen by hand."""
ROUNDS = range(12)
"""Of the search; chosen by hand."""
TURNS = SearchSpace(
    steps=np.array([0.1, 0.1, 0.3, 0.1, 0.1, 0.4, 0.05, 0.04]),
    bounds=np.array([FREE, FREE, FREE, SLOPES, SLOPES, (0.5, 4.0), (0.04, 0.4), (0.0, 0.25)]),
    shrink=0.8,
)
"""Columns that are tried, their radius the distance from the axis to the largest displacement;
chosen by hand."""
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
    sign = np.where(sigmas < 0, -1.0, 1.0)

    def sigmas_alike(columns: Columns) -> FloatArray:
        return score(columns) * sign.repeat(len(columns) // max(1, len(sign)))

    unit = score.filters.views.unit
    columns, best = random_search(sigmas_alike, starts, unit, rng, rounds=ROUNDS, space=TURNS)
    return columns, sign * best
