"""One column that holds two plumes.

The pixels between two plumes are weaker evidence against a plume than those inside are for one, so
a wide column over both explains more than either alone. The displacement tells them apart: it turns
its sign at each axis, and the other way between them. A single plume has one such axis, and where a
second seems to be, nothing turns the other way between them.
"""

from functools import partial
from heapq import nlargest
from itertools import product

import cv2
import numpy as np

from geometry.arrays import FloatArray, FloatMap
from locate.fusion.search.columns import Columns, PlumeColumn
from locate.fusion.search.fit import Objective, drop_duplicates, random_search
from locate.fusion.search.score import (
    NEAREST_DEPTH_UNITS,
    clipped_sum,
    column_evidence,
    mask_out,
    score_columns,
    supporting_pixels,
)
from locate.fusion.views import Views

HALF_GAPS_UNITS = (0.3, 0.45, 0.6)
DIRECTIONS_RAD = np.arange(4) * np.pi / 4
"""Where the two axes are first put: half their distance in units of fusion, and its direction;
chosen by hand."""
RADIUS_UNITS = 0.12
"""Of a narrow plume, units of fusion; chosen by hand."""
MOST_SIGMAS = 4.0
"""A pixel counts for no more than this; chosen by hand."""
FIT_PASSES = 2
"""How often either axis is fitted to what the other leaves; chosen by hand."""
LEAST_GAP_RADII = 3.0
"""Distance of two axes, in radii of a narrow plume, from which on a view can tell them apart."""
LEAST_SEPARATION = 4.0
"""What two plumes need of `_separation_score`: of 35 single plumes by which it was developed
none had more than 0, of six pairs 1 m apart five had 3.5 to 97."""
LEAST_SHARE = 0.55
"""What the displacement turns at the weaker axis at least, of that at the stronger one: pairs
had 0.59 and more, flanks of wide updrafts less (docs/archive/tried.md)."""
MOST_STARTS = 6
"""First pairs that are fitted; chosen by hand."""
LEAST_WEIGHT = 1e-3
"""Keeps the sigmas finite where nothing was measured, 1 / px^2."""


def split_column(
    views: Views, column: PlumeColumn, rng: np.random.Generator
) -> list[tuple[PlumeColumn, Views]]:
    """The two plumes that a column holds, each with the views in which the other is masked out.

    Empty where it holds one, or they cannot be separated: see `_separation_score`.
    """
    unit = views.unit
    wide = _fit_column(partial(column_evidence, views), column, unit, rng)
    reversals = _reversal_views(views, wide)
    starts = nlargest(
        MOST_STARTS, _candidate_pairs(wide, unit), key=lambda pair: _pair_reversal(reversals, *pair)
    )
    pairs = [_fit_pair(reversals, *pair, rng) for pair in starts]
    apart = [pair for pair in pairs if len(drop_duplicates(Columns.of(pair), unit)) == 2]
    separations = [_separation_score(reversals, *pair) for pair in apart]
    if max(separations, default=0.0) < LEAST_SEPARATION:
        return []
    best = apart[int(np.argmax(separations))]
    first, second = Columns.of(best).with_even_radius(best[0].gap_to(best[1]) / 2)
    return [
        (first, mask_out(views, second, radii=1.0)),
        (second, mask_out(views, first, radii=1.0)),
    ]


def _reversal_views(views: Views, column: PlumeColumn) -> Views:
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
        sigmas[i] = _reversal_sigmas(displacement, views.displacement_precision[i], radius_px)
    away = np.sign((sigmas[supporting_pixels(views, column)] ** 3).sum())
    reversal = np.clip(away * sigmas, -MOST_SIGMAS, MOST_SIGMAS)
    reversal = np.where(views.llr > 0, reversal, np.minimum(reversal, 0))
    return views.with_evidence(reversal.astype(np.float32))


def _reversal_sigmas(displacement: FloatMap, precision: FloatMap, radius_px: float) -> FloatMap:
    """(H, W) sigmas by which (H, W, 2) displacements point away from each pixel."""
    reach = int(np.ceil(3 * radius_px))
    away = np.arange(-reach, reach + 1, dtype=np.float32) / np.float32(radius_px)
    near = np.exp(-(away**2) / 2)

    def sum_around(image: FloatMap, across: FloatMap, along: FloatMap) -> FloatMap:
        return np.asarray(cv2.sepFilter2D(image, -1, across, along, borderType=cv2.BORDER_CONSTANT))

    x, y = (precision * displacement[..., k] for k in (0, 1))
    turn = sum_around(x, away * near, near) + sum_around(y, near, away * near)
    weight = sum_around(precision, (away * near) ** 2, near**2)
    weight += sum_around(precision, near**2, (away * near) ** 2)
    return np.asarray(turn / np.sqrt(np.maximum(weight, LEAST_WEIGHT)))


def _separation_score(reversals: Views, first: PlumeColumn, second: PlumeColumn) -> float:
    """How surely the displacement turns at both axes, and the other way between them.

    Summed over the views from where they are `LEAST_GAP_RADII` of a narrow plume apart; each
    counts as the weakest of the three does. 0 where the displacement turns at one of them much
    less than at the other: a wide plume has such a flank.
    """
    (level,) = second.axis_points(np.array([first.lowest_z - second.lowest_z]))
    second = second.moved_to(level)
    columns = Columns.of([first, second, first.midway_to(second)])
    radius = RADIUS_UNITS * reversals.unit
    turned = score_columns(reversals, columns.with_even_radius(radius)) * [1, 1, -1]
    apart = _apparent_gap(reversals, first, second) > LEAST_GAP_RADII * radius
    weaker, stronger = np.sort(turned[apart, :2].sum(axis=0))
    if weaker < LEAST_SHARE * stronger:
        return 0.0
    return float(clipped_sum((turned.min(axis=1) * apart)[:, None])[0])


def _apparent_gap(views: Views, first: PlumeColumn, second: PlumeColumn) -> FloatArray:
    """(V,) world units between two axes at half their height, as seen across the first.

    Both count their height from the same level.
    """
    middles = Columns.of([first, second]).axis_points(np.full((2, 1), first.height / 2))[:, 0]
    rays = middles[0] - views.trajectory.centers_in_world
    across = np.cross(first.direction, rays)
    across /= np.maximum(np.linalg.norm(across, axis=1, keepdims=True), 1e-12)
    return np.asarray(np.abs(across @ (middles[1] - middles[0])))


def _candidate_pairs(column: PlumeColumn, unit: float) -> list[tuple[PlumeColumn, PlumeColumn]]:
    """Pairs of columns on both sides of its axis."""
    pairs = []
    for angle, half_gap in product(DIRECTIONS_RAD, HALF_GAPS_UNITS):
        aside = np.array([half_gap * unit * np.cos(angle), half_gap * unit * np.sin(angle)])
        pairs.append((column.shifted(aside), column.shifted(-aside)))
    return pairs


def _fit_pair(
    reversals: Views, first: PlumeColumn, second: PlumeColumn, rng: np.random.Generator
) -> tuple[PlumeColumn, PlumeColumn]:
    """Two axes fitted in turns, each to what the other leaves."""
    for _ in range(FIT_PASSES):
        first = _fit_column(
            partial(_axis_reversal, _mask_axis(reversals, second)), first, reversals.unit, rng
        )
        second = _fit_column(
            partial(_axis_reversal, _mask_axis(reversals, first)), second, reversals.unit, rng
        )
    return first, second


def _fit_column(
    objective: Objective, column: PlumeColumn, unit: float, rng: np.random.Generator
) -> PlumeColumn:
    columns, _ = random_search(objective, column.as_columns, unit, rng)
    return columns[0]


def _axis_reversal(reversals: Views, columns: Columns) -> FloatArray:
    """(N,) how much turns at the axes of columns, whatever their width.

    A view that shows one of two is no evidence against the other.
    """
    narrow = columns.with_even_radius(RADIUS_UNITS * reversals.unit)
    return clipped_sum(np.maximum(score_columns(reversals, narrow), 0))


def _mask_axis(reversals: Views, other: PlumeColumn) -> Views:
    return mask_out(reversals, other.with_even_radius(RADIUS_UNITS * reversals.unit), radii=1.0)


def _pair_reversal(reversals: Views, first: PlumeColumn, second: PlumeColumn) -> float:
    """What turns at two axes; where both cover the same it counts once."""
    rest = _axis_reversal(_mask_axis(reversals, first), second.as_columns)
    return float(_axis_reversal(reversals, first.as_columns)[0] + rest[0])
