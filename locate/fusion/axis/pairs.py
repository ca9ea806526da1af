"""One column that holds two plumes.

Silence between two plumes speaks less against a plume than their evidence speaks for one, so a wide
column over both explains more than either alone. The displacement tells them apart: it turns its
sign at each axis, and the other way between them. A single plume has one such axis, and where a
second seems to be, nothing turns the other way between them.
"""

from functools import partial
from heapq import nlargest
from itertools import product

import cv2
import numpy as np

from geometry.arrays import FloatArray, FloatMap
from locate.fusion.search.columns import Columns, PlumeColumn
from locate.fusion.search.fit import Worth, climb, distinct
from locate.fusion.search.score import (
    NEAREST_DEPTH_UNITS,
    agreed,
    covered,
    evidence,
    score,
    without,
)
from locate.fusion.views import Views

HALF_GAPS_UNITS = (0.3, 0.45, 0.6)
DIRECTIONS_RAD = np.arange(4) * np.pi / 4
RADIUS_UNITS = 0.12
MOST_SIGMAS = 4.0
FITTED_IN_TURNS = 2
SEEN_APART_RADII = 3.0
LEAST_TOLD = 4.0
LEAST_SHARE = 0.55
STARTS = 6
LEAST_WEIGHT = 1e-3


def split(
    views: Views, column: PlumeColumn, rng: np.random.Generator
) -> list[tuple[PlumeColumn, Views]]:
    """The two plumes that a column holds, each with the views in which the other does not stand.

    None where it holds one, or none can tell: see `_told_apart`.
    """
    unit = views.unit
    wide = _climbed(partial(evidence, views), column, unit, rng)
    turns = _turns(views, wide)
    starts = nlargest(STARTS, _apart(wide, unit), key=lambda pair: _explained(turns, *pair))
    pairs = [_fitted(turns, *pair, rng) for pair in starts]
    apart = [pair for pair in pairs if len(distinct(Columns.of(pair), unit)) == 2]
    told = [_told_apart(turns, *pair) for pair in apart]
    if max(told, default=0.0) < LEAST_TOLD:
        return []
    best = apart[int(np.argmax(told))]
    first, second = Columns.of(best).with_even_radius(best[0].gap_to(best[1]) / 2)
    return [
        (first, without(views, second, radii=1.0)),
        (second, without(views, first, radii=1.0)),
    ]


def _turns(views: Views, column: PlumeColumn) -> Views:
    """The views with, for evidence, how surely the displacement turns its sign, in sigmas.

    Positive where it does as at the plume's axis. Each pixel's neighbourhood is as large as a
    narrow plume's radius is there.
    """
    middle = column.axis_points(np.array([column.height]) / 2)
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


def _told_apart(turns: Views, first: PlumeColumn, second: PlumeColumn) -> float:
    """How surely the displacement turns at both axes, and the other way between them.

    Summed over the views from where they stand apart by `SEEN_APART_RADII` of a narrow plume; each
    says what the weakest of the three does. 0 where the displacement turns at one of them much less
    than at the other: a wide plume has such a flank.
    """
    (level,) = second.axis_points(np.array([first.lowest_z - second.lowest_z]))
    second = second.moved_to(level)
    columns = Columns.of([first, second, first.midway_to(second)])
    turned = score(turns, columns.with_even_radius(RADIUS_UNITS * turns.unit)) * [1, 1, -1]
    apart = _seen_apart(turns, first, second) > SEEN_APART_RADII * RADIUS_UNITS * turns.unit
    weaker, stronger = np.sort(turned[apart, :2].sum(axis=0))
    if weaker < LEAST_SHARE * stronger:
        return 0.0
    return float(agreed((turned.min(axis=1) * apart)[:, None])[0])


def _seen_apart(views: Views, first: PlumeColumn, second: PlumeColumn) -> FloatArray:
    """(V,) world units between two axes at half their height, as seen across the first.

    Both count their height from the same level.
    """
    middles = Columns.of([first, second]).axis_points(np.full((2, 1), first.height / 2))[:, 0]
    rays = middles[0] - views.trajectory.centers_in_world
    across = np.cross(first.direction, rays)
    across /= np.maximum(np.linalg.norm(across, axis=1, keepdims=True), 1e-12)
    return np.asarray(np.abs(across @ (middles[1] - middles[0])))


def _apart(column: PlumeColumn, unit: float) -> list[tuple[PlumeColumn, PlumeColumn]]:
    """Pairs of columns on both sides of its axis."""
    pairs = []
    for angle, half_gap in product(DIRECTIONS_RAD, HALF_GAPS_UNITS):
        aside = np.array([half_gap * unit * np.cos(angle), half_gap * unit * np.sin(angle)])
        pairs.append((column.shifted(aside), column.shifted(-aside)))
    return pairs


def _fitted(
    turns: Views, first: PlumeColumn, second: PlumeColumn, rng: np.random.Generator
) -> tuple[PlumeColumn, PlumeColumn]:
    """Two axes fitted in turns, each to what the other leaves."""
    for _ in range(FITTED_IN_TURNS):
        first = _climbed(partial(_shown, _left(turns, second)), first, turns.unit, rng)
        second = _climbed(partial(_shown, _left(turns, first)), second, turns.unit, rng)
    return first, second


def _climbed(
    worth: Worth, column: PlumeColumn, unit: float, rng: np.random.Generator
) -> PlumeColumn:
    columns, _ = climb(worth, column.alone, unit, rng)
    return columns[0]


def _shown(turns: Views, columns: Columns) -> FloatArray:
    """(N,) how much turns at the axes of columns, whatever their width.

    A view that sees one of two does not speak against the other.
    """
    narrow = columns.with_even_radius(RADIUS_UNITS * turns.unit)
    return agreed(np.maximum(score(turns, narrow), 0))


def _left(turns: Views, other: PlumeColumn) -> Views:
    return without(turns, other.with_even_radius(RADIUS_UNITS * turns.unit), radii=1.0)


def _explained(turns: Views, first: PlumeColumn, second: PlumeColumn) -> float:
    """What turns at two axes; where both cover the same it counts once."""
    rest = _shown(_left(turns, first), second.alone)
    return float(_shown(turns, first.alone)[0] + rest[0])
