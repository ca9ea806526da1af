"""The whole of fusion: evidence of many views in, plumes out."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from functools import reduce

import numpy as np

from geometry.arrays import FloatArray, IntArray
from geometry.grid import EvidenceGrid
from locate.fusion.axis import VIEW_SAW_NATS, sight_axis
from locate.fusion.base import locate_base
from locate.fusion.column import (
    HEIGHT,
    OPENING,
    RADIUS,
    SLOPE_X,
    SLOPE_Y,
    X,
    Y,
    agreed,
    score,
    spine,
    without,
)
from locate.fusion.fit import fit_columns
from locate.fusion.graph import AxisEstimate, estimate_axis
from locate.fusion.null import NullLevel
from locate.fusion.pairs import split
from locate.fusion.proposals import STARTS, propose
from locate.fusion.views import Views
from locate.plume import Plume

FALSE_ALARM = 0.01
NULL_SHARE = 0.8  # of the time that fusion takes
REFINEMENTS = 3
RADIUS_SAMPLES = 9
FAR_UNITS = 1.0
GHOST_SHARE = 0.1


@dataclass(frozen=True, kw_only=True)
class Fused:
    """What fusion found.

    Attributes:
        plumes: Strongest first.
        grid: The summed evidence; None where no frame measured any depth.
        threshold_nats: What a column needs to count as a plume.
    """

    plumes: tuple[Plume, ...]
    grid: EvidenceGrid | None
    threshold_nats: float


def fuse(
    views: Views,
    *,
    seed: int = 0,
    progress: Callable[[float], None] = lambda _share: None,
    null: NullLevel | None = None,
    most_false_alarm: float = FALSE_ALARM,
    least_nats: float = 0.0,
) -> Fused:
    """Finds the plumes that the summed evidence of all views speaks for.

    A strong plume makes strong chance columns too. Once it is found and taken out, the level is
    drawn anew where a column stands far from it; a tenth of its evidence at least must speak for
    that, as what is left of a strong plume agrees by itself. Several strong ones can hide each
    other so: where `least_nats` says what clutter makes, all above that are taken out of the draws.

    Args:
        views: The evidence.
        seed: Of every random choice.
        progress: Told the share done, from 0 to 1.
        null: What chance makes of these views; drawn from them where it is not known yet.
        most_false_alarm: Columns that chance makes more often than this are no plumes.
        least_nats: Weaker columns are none either, whatever chance makes.
    """
    rng = np.random.default_rng(seed)
    unit = views.unit
    if np.isnan(unit):
        return Fused(plumes=(), grid=None, threshold_nats=np.inf)
    box = views.volume()
    drawn = null is None
    if null is None:
        null = NullLevel.from_views(
            views, box, unit, rng, progress=lambda share: progress(NULL_SHARE * share)
        )
    proposals, grid = propose(views, box, unit, most=STARTS)
    columns = fit_columns(views, proposals.columns, unit, rng)
    level = max(null.threshold(most_false_alarm), least_nats)
    plumes, left = _take(views, columns, unit, null, level, rng)
    strongest = max((evidence(views, column) for column in columns), default=0.0)
    floor = max(least_nats, GHOST_SHARE * strongest)
    far = _far_columns(left, columns, plumes, floor)
    if drawn and far and (plumes or least_nats):
        calm = reduce(without, far, left) if least_nats else left
        null = NullLevel.from_views(calm, box, unit, rng, progress=lambda _share: None)
        level = max(null.threshold(most_false_alarm), least_nats)
        more, _ = _take(left, far, unit, null, max(level, floor), rng)
        plumes += more
    progress(1.0)
    plumes.sort(key=lambda plume: -plume.evidence_nats)
    numbered = (replace(plume, id=number) for number, plume in enumerate(plumes, start=1))
    return Fused(plumes=tuple(numbered), grid=grid, threshold_nats=level)


def _take(
    views: Views,
    columns: Iterable[FloatArray],
    unit: float,
    null: NullLevel,
    level: float,
    rng: np.random.Generator,
) -> tuple[list[Plume], Views]:
    """The plumes among the columns, and the views without what those explain."""
    plumes: list[Plume] = []
    for start in columns:
        if evidence(views, start) < level:
            continue
        parts = split(views, start, unit, rng)
        found = _measured(parts, unit, null, level)
        if len(found) < len(parts):
            found = _measured([(start, views)], unit, null, level)
        for column, plume in found:
            plumes.append(plume)
            views = without(views, column)
    return plumes, views


def _measured(
    parts: list[tuple[FloatArray, Views]], unit: float, null: NullLevel, level: float
) -> list[tuple[FloatArray, Plume]]:
    """Those of the columns that are plumes, with the columns where they really stand.

    Of two that one column held, each needs half of what a plume alone does: that something stands
    there was shown by both.
    """
    found = []
    for part, views in parts:
        refined = refine_axis(views, part, unit)
        if refined is None:
            continue
        column, axis = refined
        strength = len(parts) * evidence(views, column)
        if strength >= level:
            plume = _plume(views, column, axis, unit, null.false_alarm(strength))
            found.append((column, plume))
    return found


def _far_columns(
    left: Views, columns: FloatArray, plumes: list[Plume], floor: float
) -> list[FloatArray]:
    """Strong columns that stand too far from every plume to be what it left of its evidence."""
    places = np.reshape([plume.source[:2] for plume in plumes], (-1, 2))
    apart = np.linalg.norm(columns[:, None, [X, Y]] - places, axis=2).min(axis=1, initial=np.inf)
    far = columns[apart > FAR_UNITS * left.unit]
    return [column for column in far if evidence(left, column) >= floor]


def evidence(views: Views, column: FloatArray) -> float:
    """What all views together say for one column, nats."""
    return float(agreed(score(views, column[None]))[0])


def refine_axis(
    views: Views, column: FloatArray, unit: float
) -> tuple[FloatArray, AxisEstimate] | None:
    """Sights the axis and solves for it in turns; None where too few views see it."""
    axis = None
    for _ in range(REFINEMENTS):
        sightings = sight_axis(views, column)
        origin = locate_base(views, column, unit).height
        axis = estimate_axis(views.trajectory, column, sightings, unit, origin=origin)
        if axis is None:
            return None
        column = _moved(column, axis.line)
    return None if axis is None else (column, axis)


def _moved(column: FloatArray, line: FloatArray) -> FloatArray:
    """The column with its axis on another line (x and y at its lowest point, slopes)."""
    moved = column.copy()
    moved[[X, Y, SLOPE_X, SLOPE_Y]] = line
    return moved


def locate_source(
    views: Views, column: FloatArray, axis: AxisEstimate, unit: float
) -> tuple[FloatArray, FloatArray]:
    """(3,) source and its (3, 3) covariance.

    An axis that stands a little elsewhere may meet another surface, or none; so the base is
    sought along several lines that the sightings allow.
    """
    candidates = [_moved(column, line) for line in axis.spread()]
    bases = [locate_base(views, candidate, unit) for candidate in candidates]
    heights = np.array([[base.height] for base in bases])
    points = spine(np.array(candidates), heights)[:, 0]
    along = float(np.mean([base.sigma**2 for base in bases]))
    covariance = np.cov(points.T, bias=True) + along * np.outer(axis.rise, axis.rise)
    return points.mean(axis=0), covariance


def _plume(
    views: Views, column: FloatArray, axis: AxisEstimate, unit: float, false_alarm: float
) -> Plume:
    base = locate_base(views, column, unit)
    source, covariance = locate_source(views, column, axis, unit)
    heights = np.linspace(base.lowest_seen, base.highest_seen, RADIUS_SAMPLES)
    radii = column[RADIUS] + column[OPENING] * np.clip(heights, 0, None)
    distances = (heights - (source[2] - axis.lowest)) * np.linalg.norm(axis.rise)
    saw = score(views, column[None])[:, 0] > VIEW_SAW_NATS
    return Plume(
        id=0,
        source=source,
        source_covariance=covariance,
        axis=axis.direction,
        axis_sigma_rad=axis.direction_sigma_rad,
        extent_low=float(distances[0]),
        extent_high=float(distances[-1]),
        radius_by_height=np.column_stack([distances, radii]),
        evidence_nats=evidence(views, column),
        probability=1 - false_alarm,
        views=tuple(int(index) for index in views.trajectory.indices[saw]),
        displacement_px=_displacement(views, column, np.flatnonzero(saw)),
        source_hidden=base.hidden,
    )


def _displacement(views: Views, column: FloatArray, rows: IntArray) -> float:
    """Mean displacement along the axis in the views of these rows, px of the original frames."""
    heights = np.linspace(0, column[HEIGHT], RADIUS_SAMPLES)
    points = spine(column[None], heights[None])[0]
    height, width = views.llr.shape[1:]
    values = []
    for i in rows:
        pixel = views.trajectory.project(int(i), points)
        pixel = np.rint(pixel[np.isfinite(pixel).all(axis=1)]).astype(int)
        inside = ((pixel >= 0) & (pixel < [width, height])).all(axis=1)
        values.append(views.displacement_px[i][pixel[inside, 1], pixel[inside, 0]])
    return float(np.concatenate(values).mean())
