"""One column that holds two plumes.

Silence between two plumes speaks less against a plume than their evidence speaks for one, so a wide
column over both explains more of it than either alone. Held against half of what the plume itself
has, silence counts as much as evidence: then two narrow columns explain clearly more than a wide
one, and of a single plume there is nothing left to explain for a second.
"""

from dataclasses import replace
from functools import partial
from heapq import nlargest
from itertools import product

import numpy as np

from geometry.arrays import FloatArray
from locate.fusion.column import (
    OPENING,
    RADIUS,
    X,
    Y,
    agreed,
    covered,
    evidence,
    score,
    without,
)
from locate.fusion.fit import Worth, climb, distinct
from locate.fusion.views import Views

LEVEL_SHARE = 0.5
HALF_GAPS_UNITS = (0.3, 0.45, 0.6)
DIRECTIONS_RAD = np.arange(4) * np.pi / 4
RADIUS_UNITS, OPENING_START = 0.12, 0.06
FITTED_IN_TURNS = 2
LEAST_GAIN, LEAST_SHARE = 0.3, 0.2
STARTS = 2


def split(
    views: Views, column: FloatArray, unit: float, rng: np.random.Generator
) -> list[tuple[FloatArray, Views]]:
    """The two plumes that a column holds, each with the views in which the other does not stand.

    None where it holds one: two stand apart at all heights, explain `LEAST_GAIN` more, and each has
    `LEAST_SHARE` of its evidence where the other does not stand.
    """
    wide = _climbed(partial(evidence, views), column, unit, rng)
    sharp = _sharpened(views, wide)
    single = _climbed(partial(_shown, sharp), wide, unit, rng)
    least = (1 + LEAST_GAIN) * float(_shown(sharp, single[None])[0])
    starts = nlargest(STARTS, _apart(wide, unit), key=lambda pair: _explained(sharp, *pair))
    pairs = [_fitted(sharp, *pair, unit, rng) for pair in starts]
    apart = [pair for pair in pairs if len(distinct(np.stack(pair), unit)) == 2]
    best = max(apart, key=lambda pair: _explained(sharp, *pair), default=None)
    if best is None or _explained(sharp, *best) < least:
        return []
    first, second = best
    parts = [(first, _alone(views, second)), (second, _alone(views, first))]
    weaker = min(float(evidence(alone, part[None])[0]) for part, alone in parts)
    return parts if weaker > LEAST_SHARE * float(evidence(views, wide[None])[0]) else []


def _fitted(
    sharp: Views, first: FloatArray, second: FloatArray, unit: float, rng: np.random.Generator
) -> tuple[FloatArray, FloatArray]:
    """Two columns fitted in turns, each to what the other leaves."""
    for _ in range(FITTED_IN_TURNS):
        first = _climbed(partial(_shown, _alone(sharp, second)), first, unit, rng)
        second = _climbed(partial(_shown, _alone(sharp, first)), second, unit, rng)
    return first, second


def _sharpened(views: Views, column: FloatArray) -> Views:
    """The evidence less a share of what the pixels that speak for the column say."""
    inside = covered(views, column)
    level = LEVEL_SHARE * views.llr[inside].mean() if inside.any() else 0.0
    llr = np.where(views.llr == 0, 0, views.llr - level)
    return replace(views, llr=llr.astype(np.float32))


def _apart(column: FloatArray, unit: float) -> list[tuple[FloatArray, FloatArray]]:
    """Pairs of narrow columns on both sides of its axis."""
    narrow = column.copy()
    narrow[[RADIUS, OPENING]] = RADIUS_UNITS * unit, OPENING_START
    pairs = []
    for angle, half_gap in product(DIRECTIONS_RAD, HALF_GAPS_UNITS):
        aside = np.zeros(8)
        aside[[X, Y]] = half_gap * unit * np.cos(angle), half_gap * unit * np.sin(angle)
        pairs.append((narrow + aside, narrow - aside))
    return pairs


def _alone(views: Views, other: FloatArray) -> Views:
    return without(views, other, radii=1.0)


def _climbed(worth: Worth, column: FloatArray, unit: float, rng: np.random.Generator) -> FloatArray:
    columns, _ = climb(worth, column[None], unit, rng)
    return np.asarray(columns[0])


def _shown(views: Views, columns: FloatArray) -> FloatArray:
    """(N,) evidence for columns; a view that sees one of two does not speak against the other."""
    return agreed(np.maximum(score(views, columns), 0))


def _explained(views: Views, first: FloatArray, second: FloatArray) -> float:
    """What two columns explain, nats; what both cover counts once."""
    rest = _shown(_alone(views, first), second[None])
    return float(_shown(views, first[None])[0] + rest[0])
