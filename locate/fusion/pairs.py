"""One column that holds two plumes.

Silence between two plumes speaks less against a plume than their evidence speaks for one, so a wide
column over both explains more than either alone. The displacement tells them apart: it turns its
sign at each axis, and the other way between them. Of a single plume there is one such axis, and
nothing left to turn at a second.
"""

from functools import partial
from heapq import nlargest
from itertools import product

import cv2
import numpy as np

from geometry.arrays import FloatArray, FloatMap
from locate.fusion.column import (
    HEIGHT,
    NEAREST_DEPTH_UNITS,
    OPENING,
    RADIUS,
    X,
    Y,
    agreed,
    covered,
    evidence,
    score,
    spine,
    without,
)
from locate.fusion.fit import Worth, climb, distinct, gap
from locate.fusion.views import Views

HALF_GAPS_UNITS = (0.3, 0.45, 0.6)
DIRECTIONS_RAD = np.arange(4) * np.pi / 4
RADIUS_UNITS = 0.12
MOST_SIGMAS = 4.0
FITTED_IN_TURNS = 2
LEAST_GAIN = 0.7
STARTS = 3
LEAST_WEIGHT = 1e-3


def split(
    views: Views, column: FloatArray, unit: float, rng: np.random.Generator
) -> list[tuple[FloatArray, Views]]:
    """The two plumes that a column holds, each with the views in which the other does not stand.

    None where it holds one: at two axes that stand apart at all heights the displacement must turn
    `LEAST_GAIN` more than at any single one. Where it turns nowhere, nothing tells two from one.
    """
    wide = _climbed(partial(evidence, views), column, unit, rng)
    turns = _turns(views, wide)
    shown = partial(_shown, turns)
    single = _climbed(shown, wide, unit, rng)
    starts = nlargest(STARTS, _apart(wide, unit), key=lambda pair: _explained(turns, *pair))
    pairs = [_fitted(turns, *pair, rng) for pair in starts]
    apart = [pair for pair in pairs if len(distinct(np.stack(pair), unit)) == 2]
    if not apart:
        return []
    explained = [_explained(turns, *pair) for pair in apart]
    best = apart[int(np.argmax(explained))]
    alone = float(shown(np.stack([single, *best])).max())
    if alone == 0 or max(explained) < (1 + LEAST_GAIN) * alone:
        return []
    first, second = _with_radius(np.stack(best), gap(*best) / 2)
    return [
        (first, without(views, second, radii=1.0)),
        (second, without(views, first, radii=1.0)),
    ]


def _turns(views: Views, column: FloatArray) -> Views:
    """The views with, for evidence, how surely the displacement turns its sign, in sigmas.

    Positive where it does as at the plume's axis. Each pixel's neighbourhood is as large as a
    narrow plume's radius is there.
    """
    middle = spine(column[None], column[None, HEIGHT, None] / 2)[0]
    sigmas = np.zeros_like(views.llr)
    for i, displacement in enumerate(views.displacement):
        depth = float(views.trajectory.world_to_cam(i, middle)[0, 2])
        depth = max(depth, NEAREST_DEPTH_UNITS * views.unit)
        radius_px = max(1.0, views.trajectory.camera.focal_px * RADIUS_UNITS * views.unit / depth)
        sigmas[i] = _turning(displacement, views.precision[i], radius_px)
    away = np.sign((sigmas[covered(views, column)] ** 3).sum())
    said = np.clip(away * sigmas, -MOST_SIGMAS, MOST_SIGMAS)
    said = np.where(views.llr > 0, said, np.minimum(said, 0))
    return views.saying(said.astype(np.float32))


def _turning(displacement: FloatMap, precision: FloatMap, radius_px: float) -> FloatMap:
    """(H, W) sigmas by which (H, W, 2) displacements point away from each pixel."""
    reach = int(np.ceil(3 * radius_px))
    away = np.arange(-reach, reach + 1, dtype=np.float32) / np.float32(radius_px)
    near = np.exp(-(away**2) / 2)

    def summed(image: FloatMap, across: FloatMap, along: FloatMap) -> FloatMap:
        return np.asarray(cv2.sepFilter2D(image, -1, across, along, borderType=cv2.BORDER_CONSTANT))

    x, y = (precision * displacement[..., k] for k in (0, 1))
    turn = summed(x, away * near, near) + summed(y, near, away * near)
    weight = summed(precision, (away * near) ** 2, near**2)
    weight += summed(precision, near**2, (away * near) ** 2)
    return np.asarray(turn / np.sqrt(np.maximum(weight, LEAST_WEIGHT)))


def _apart(column: FloatArray, unit: float) -> list[tuple[FloatArray, FloatArray]]:
    """Pairs of columns on both sides of its axis."""
    pairs = []
    for angle, half_gap in product(DIRECTIONS_RAD, HALF_GAPS_UNITS):
        aside = np.zeros(8)
        aside[[X, Y]] = half_gap * unit * np.cos(angle), half_gap * unit * np.sin(angle)
        pairs.append((column + aside, column - aside))
    return pairs


def _fitted(
    turns: Views, first: FloatArray, second: FloatArray, rng: np.random.Generator
) -> tuple[FloatArray, FloatArray]:
    """Two axes fitted in turns, each to what the other leaves."""
    for _ in range(FITTED_IN_TURNS):
        first = _climbed(partial(_shown, _left(turns, second)), first, turns.unit, rng)
        second = _climbed(partial(_shown, _left(turns, first)), second, turns.unit, rng)
    return first, second


def _climbed(worth: Worth, column: FloatArray, unit: float, rng: np.random.Generator) -> FloatArray:
    columns, _ = climb(worth, column[None], unit, rng)
    return np.asarray(columns[0])


def _with_radius(columns: FloatArray, radius: float) -> FloatArray:
    """(..., 8) columns with this radius at every height."""
    even = columns.copy()
    even[..., RADIUS], even[..., OPENING] = radius, 0.0
    return even


def _shown(turns: Views, columns: FloatArray) -> FloatArray:
    """(N,) how much turns at the axes of columns, whatever their width.

    A view that sees one of two does not speak against the other.
    """
    narrow = _with_radius(columns, RADIUS_UNITS * turns.unit)
    return agreed(np.maximum(score(turns, narrow), 0))


def _left(turns: Views, other: FloatArray) -> Views:
    return without(turns, _with_radius(other, RADIUS_UNITS * turns.unit), radii=1.0)


def _explained(turns: Views, first: FloatArray, second: FloatArray) -> float:
    """What turns at two axes; where both cover the same it counts once."""
    rest = _shown(_left(turns, first), second[None])
    return float(_shown(turns, first[None])[0] + rest[0])
