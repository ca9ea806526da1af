"""Columns moved and bent until the displacement turns about them most."""

from dataclasses import dataclass, field
from typing import Self

import numpy as np

from geometry.arrays import BoolArray, FloatArray
from locate.fusion.matched.score import TurnScore
from locate.fusion.search.columns import HEIGHT, RADIUS, Columns, PlumeColumn, X, Y
from locate.fusion.search.fit import FREE, SLOPES, Objective, SearchSpace, random_search

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
NEAR_ROUNDS = range(4, 12)
"""Of that search: it begins with small steps; chosen by hand."""
TRIES = 4
"""How often the views' agreement on one turn is sought, as one search may end early; chosen by
hand."""
APART_UNITS = 0.3
"""Axes nearer than this are one plume's, units of fusion; chosen by hand."""
BESIDE_UNITS = 0.8
"""How near a plume the displacement may turn the other way because of it, units of fusion. Set on
the door of docs/real_frames.md."""


@dataclass(frozen=True, eq=False)
class Turn:
    """A column about which the displacement turns.

    Attributes:
        column: Its radius is the distance from the axis to the largest displacement.
        sigmas: How surely; positive where light is bent away from the axis.
        spread: (4, 4) mean square of by how much the x, y and slopes of axes that show about as
            much differ from its own, at its lowest point.
    """

    column: PlumeColumn
    sigmas: float
    spread: FloatArray = field(default_factory=lambda: np.zeros((4, 4)))

    @classmethod
    def best_of(cls, columns: Columns, sigmas: FloatArray, best: int, reach: float) -> Self:
        """One of N columns, with the spread of those near it that turn the same way.

        They are weighted by the likelihood that their sigmas stand for. Near a strong plume many
        axes reach the most that counts, and the best of them is one by chance.

        Args:
            columns: N columns.
            sigmas: (N,) of each.
            best: Number of the one.
            reach: How far axes may lie from it, world units.
        """
        column = columns[best]
        close = np.array([each.gap_to(column) <= reach for each in columns])
        near = np.flatnonzero(close & (sigmas * sigmas[best] > 0))
        rises = np.array([[column.lowest_z - columns[k].lowest_z] for k in near])
        points = columns.take(near).axis_points(rises)[:, 0, :2]
        slopes = np.array([columns[k].slope for k in near])
        apart = np.hstack([points - column.lowest_point[:2], slopes - column.slope])
        weights = np.exp((sigmas[near] ** 2 - sigmas[best] ** 2) / 2)
        spread = np.einsum("n,ni,nj->ij", weights / weights.sum(), apart, apart)
        return cls(column, float(sigmas[best]), spread)


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
    columns, sigmas = _climb(score, unit, proposals.take(best), sign, rng)
    surest = np.argsort(-np.abs(sigmas), kind="stable")
    found: list[Turn] = []
    for k in surest[~_beside_a_stronger(score, columns, sigmas)[surest]]:
        column = columns[k]
        if all(column.gap_to(other.column) > APART_UNITS * unit for other in found):
            found.append(Turn.best_of(columns, sigmas, int(k), APART_UNITS * unit))
    return found


def _beside_a_stronger(score: TurnScore, columns: Columns, sigmas: FloatArray) -> BoolArray:
    """(N,) whether near a column lies one about which the displacement turns the other way, more.

    Beside a plume the displacement turns back, and where neighbouring frames see the plume it turns
    the other way. Near a strong plume every place of such a column reaches the most that counts, as
    the plume does.
    """
    near = BESIDE_UNITS * score.filters.views.unit
    strength = np.abs(score.unlimited(columns))
    beside = np.zeros(len(columns), np.bool_)
    for k, column in enumerate(columns):
        stronger = np.flatnonzero((sigmas * sigmas[k] < 0) & (strength > strength[k]))
        beside[k] = any(column.gap_to(columns[j]) < near for j in stronger)
    return beside


def strongest_turn_near(score: TurnScore, column: PlumeColumn, rng: np.random.Generator) -> float:
    """Sigmas on which the views agree, of the turn near a column on which they agree most.

    Args:
        score: Of columns.
        column: Its radius is the distance from the axis to the largest displacement.
        rng: Of the search.
    """
    unit = score.filters.views.unit
    starts = np.repeat(column.array[None], NEAR_STARTS, axis=0)
    starts[1:, [X, Y]] += rng.normal(0, NEAR_UNITS * unit, (NEAR_STARTS - 1, 2))
    starts[1:, [HEIGHT, RADIUS]] *= np.exp(rng.normal(0, NEAR_SPREAD, (NEAR_STARTS - 1, 2)))
    out = np.ones(NEAR_STARTS)
    ways = [_most_agreed(score, column, Columns(starts), sign, rng) for sign in (out, -out)]
    return max(ways, key=abs)


def agreed_sigmas(score: TurnScore, turn: Turn, rng: np.random.Generator) -> float:
    """Sigmas on which the views agree, of the column by a turn on which they agree most.

    `find_turns` climbs by all views together; where it ends, the median view may show anything.

    Args:
        score: Of columns.
        turn: That was found.
        rng: Of the search.
    """
    starts = Columns(np.repeat(turn.column.array[None], TRIES, axis=0))
    sign = np.full(TRIES, np.sign(turn.sigmas))
    return _most_agreed(score, turn.column, starts, sign, rng)


def _most_agreed(
    score: TurnScore,
    column: PlumeColumn,
    starts: Columns,
    sign: FloatArray,
    rng: np.random.Generator,
) -> float:
    """The most sigmas on which the views agree where N starts end near a column, 0 without one."""
    unit = score.filters.views.unit
    ends, sigmas = _climb(score.agreed, unit, starts, sign, rng, NEAR_ROUNDS)
    near = [column.widest_gap_to(end) < NEAR_GAP_UNITS * unit for end in ends]
    return float(max(sigmas[near], key=abs, default=0.0))


def _climb(
    objective: Objective,
    unit: float,
    starts: Columns,
    sign: FloatArray,
    rng: np.random.Generator,
    rounds: range = ROUNDS,
) -> tuple[Columns, FloatArray]:
    """Where N starts end, each by itself, and their sigmas.

    Args:
        objective: Sigmas, which are made as large as possible.
        unit: Of fusion (`Views.unit`), world units.
        starts: N columns.
        sign: (N,) 1 where light is bent away from the axis, else -1.
        rng: Of the search.
        rounds: Of the search.
    """

    def sigmas_alike(columns: Columns) -> FloatArray:
        return objective(columns) * sign.repeat(len(columns) // max(1, len(sign)))

    columns, best = random_search(sigmas_alike, starts, unit, rng, rounds=rounds, space=TURNS)
    return columns, sign * best
