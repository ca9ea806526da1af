"""Columns moved and bent until the displacement turns about them most."""

from dataclasses import dataclass

import numpy as np

from geometry.arrays import FloatArray
from locate.fusion.matched.score import TurnScore
from locate.fusion.search.columns import HEIGHT, RADIUS, Columns, PlumeColumn, X, Y
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
NEAR_STARTS, NEAR_UNITS, NEAR_SPREAD = 24, 0.15, 0.35
"""Columns from which a turn near another column is sought, how far they lie from it in units of
fusion, and the logarithmic spread of their sizes; chosen by hand."""
NEAR_GAP_UNITS = 0.4
"""How far such a turn may lie from that column, units of fusion; chosen by hand."""
NEAR_ROUNDS = range(2, 9)
"""Of that search: it begins with small steps; chosen by hand."""
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
    sign = np.where(first[best] < 0, -1.0, 1.0)
    columns, sigmas = _climb(score, proposals.take(best), sign, rng)
    found: list[Turn] = []
    for k in np.argsort(-np.abs(sigmas), kind="stable"):
        column = columns[k]
        if all(column.gap_to(other.column) > APART_UNITS * unit for other in found):
            found.append(Turn(column, float(sigmas[k])))
    return found


def strongest_turn_near(score: TurnScore, column: PlumeColumn, rng: np.random.Generator) -> float:
    """Sigmas on which the views agree, of the turn near a column on which they agree most.

    Args:
        score: What is made as large as possible.
        column: Its radius is the distance from the axis to the largest displacement.
        rng: Of the search.
    """
    unit = score.filters.views.unit
    starts = np.repeat(column.array[None], NEAR_STARTS, axis=0)
    starts[1:, [X, Y]] += rng.normal(0, NEAR_UNITS * unit, (NEAR_STARTS - 1, 2))
    starts[1:, [HEIGHT, RADIUS]] *= np.exp(rng.normal(0, NEAR_SPREAD, (NEAR_STARTS - 1, 2)))
    out = np.ones(NEAR_STARTS)
    ends = [_climb(score, Columns(starts), sign, rng, NEAR_ROUNDS) for sign in (out, -out)]
    near = [
        agreed
        for columns, _ in ends
        for each, agreed in zip(columns, score.agreed(columns), strict=True)
        if column.widest_gap_to(each) < NEAR_GAP_UNITS * unit
    ]
    return float(max(near, key=abs, default=0.0))


def _climb(
    score: TurnScore,
    starts: Columns,
    sign: FloatArray,
    rng: np.random.Generator,
    rounds: range = ROUNDS,
) -> tuple[Columns, FloatArray]:
    """Where N starts end, each by itself, and their sigmas.

    Args:
        score: What is made as large as possible.
        starts: N columns.
        sign: (N,) 1 where light is bent away from the axis, else -1.
        rng: Of the search.
        rounds: Of the search.
    """

    def sigmas_alike(columns: Columns) -> FloatArray:
        return score(columns) * sign.repeat(len(columns) // max(1, len(sign)))

    unit = score.filters.views.unit
    columns, best = random_search(sigmas_alike, starts, unit, rng, rounds=rounds, space=TURNS)
    return columns, sign * best
