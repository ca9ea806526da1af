"""The whole of fusion: evidence of many views in, plumes out."""

from dataclasses import dataclass

import numpy as np

from geometry.arrays import FloatArray
from geometry.grid import EvidenceGrid
from locate.fusion.axis import VIEW_SAW_NATS, sight_axis
from locate.fusion.base import Base, locate_base
from locate.fusion.column import (
    HEIGHT,
    OPENING,
    RADIUS,
    SLOPE_X,
    SLOPE_Y,
    X,
    Y,
    score,
    spine,
    without,
)
from locate.fusion.fit import fit_columns
from locate.fusion.graph import AxisEstimate, estimate_axis
from locate.fusion.null import NullLevel
from locate.fusion.proposals import propose
from locate.fusion.views import Views
from locate.plume import Plume

STARTS = 24
FALSE_ALARM = 0.01
REFINEMENTS = 4
RADIUS_SAMPLES = 9


@dataclass(frozen=True, kw_only=True)
class Fused:
    """What fusion found.

    Attributes:
        plumes: Strongest first.
        grid: The summed evidence.
        threshold_nats: What a column needs to count as a plume.
    """

    plumes: tuple[Plume, ...]
    grid: EvidenceGrid
    threshold_nats: float


def fuse(views: Views, *, seed: int = 0) -> Fused:
    """Finds the plumes that the summed evidence of all views speaks for."""
    rng = np.random.default_rng(seed)
    unit, box = views.unit, views.volume()
    null = NullLevel.from_views(views, box, unit, rng)
    proposals, grid = propose(views, box, unit, most=STARTS)
    columns = fit_columns(views, proposals.columns, unit, rng)
    plumes: list[Plume] = []
    left = views
    for start in columns:
        nats = score(left, start[None])[:, 0]
        false_alarm = null.false_alarm(float(nats.sum()))
        if false_alarm > FALSE_ALARM:
            continue
        refined = refine_axis(left, start, unit)
        if refined is None:
            continue
        column, axis = refined
        base = locate_base(left, column, unit)
        plumes.append(_plume(len(plumes) + 1, left, column, axis, base, nats, false_alarm))
        left = without(left, column)
    return Fused(plumes=tuple(plumes), grid=grid, threshold_nats=null.threshold(FALSE_ALARM))


def refine_axis(
    views: Views, column: FloatArray, unit: float
) -> tuple[FloatArray, AxisEstimate] | None:
    """Sights the axis and solves for it in turns; None where too few views see it."""
    axis = None
    for _ in range(REFINEMENTS):
        axis = estimate_axis(views.trajectory, sight_axis(views, column), unit)
        if axis is None:
            return None
        column = column.copy()
        column[[X, Y]] = axis.at(0.0)[0][:2]
        column[[SLOPE_X, SLOPE_Y]] = axis.rise[:2]
    return None if axis is None else (column, axis)


def _plume(
    number: int,
    views: Views,
    column: FloatArray,
    axis: AxisEstimate,
    base: Base,
    nats: FloatArray,
    false_alarm: float,
) -> Plume:
    source, covariance = axis.at(base.height)
    covariance = covariance + base.sigma**2 * np.outer(axis.rise, axis.rise)
    heights = np.linspace(base.lowest_seen, base.highest_seen, RADIUS_SAMPLES)
    radii = column[RADIUS] + column[OPENING] * np.clip(heights, 0, None)
    distances = (heights - base.height) * np.linalg.norm(axis.rise)
    saw = nats > VIEW_SAW_NATS
    return Plume(
        id=number,
        source=source,
        source_covariance=covariance,
        axis=axis.direction,
        axis_sigma_rad=axis.direction_sigma_rad,
        extent_low=float(distances[0]),
        extent_high=float(distances[-1]),
        radius_by_height=np.column_stack([distances, radii]),
        evidence_nats=float(nats.sum()),
        probability=1 - false_alarm,
        views=tuple(int(index) for index in views.trajectory.indices[saw]),
        displacement_px=_displacement(views, column),
        source_hidden=base.hidden,
    )


def _displacement(views: Views, column: FloatArray) -> float:
    """Mean displacement along the axis over all views, px of the original frames."""
    heights = np.linspace(0, column[HEIGHT], RADIUS_SAMPLES)
    points = spine(column[None], heights[None])[0]
    height, width = views.llr.shape[1:]
    values = []
    for i in range(len(views)):
        pixel = views.trajectory.project(i, points)
        pixel = np.rint(pixel[np.isfinite(pixel).all(axis=1)]).astype(int)
        inside = ((pixel >= 0) & (pixel < [width, height])).all(axis=1)
        values.append(views.displacement_px[i][pixel[inside, 1], pixel[inside, 0]])
    return float(np.concatenate(values).mean())
