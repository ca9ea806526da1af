"""One plume measured: its axis, averaged over several columns, its source and its shape."""

from collections.abc import Sequence
from functools import partial

import numpy as np

from geometry.arrays import FloatArray, IntArray
from locate.fusion.axis.estimate import AxisEstimate, average_axes, mark_consistent
from locate.fusion.axis.graph import estimate_axis
from locate.fusion.axis.sightings import VIEW_SAW_NATS, find_bending_sign, sight_axis
from locate.fusion.axis.sway import SwayHypothesis
from locate.fusion.search.columns import Columns, PlumeColumn
from locate.fusion.search.fit import ALL_ROUNDS, PLUMES, random_search
from locate.fusion.search.score import column_evidence, score_columns
from locate.fusion.source.base import locate_base
from locate.fusion.views import Views
from locate.map.plume import Plume
from locate.map.schema import RefractiveIndex

SEARCHES = 4
"""Searches that an axis is the mean of; twelve were hardly better (docs/archive/tried.md)."""
REFINEMENTS = 3
"""How often the axis is measured and solved for; chosen by hand."""
RADIUS_SAMPLES = 9
"""Heights at which radius and displacement are taken; chosen by hand."""
REFRACTIVE_INDEX: dict[int, RefractiveIndex | None] = {1: "lower", -1: "higher", 0: None}
"""Of the plume against the air around it, by its bending sign."""


def find_axis(
    views: Views,
    column: PlumeColumn,
    rng: np.random.Generator,
    *,
    rounds: range = ALL_ROUNDS,
) -> tuple[PlumeColumn, AxisEstimate] | None:
    """The column at its refined place, and its axis; None where too few views show it.

    Columns of quite another shape explain the evidence nearly as well, and their axis is measured
    elsewhere. So the axis is the mean over several searches from about the column, outliers left
    out, and its covariance holds their scatter (Rubin, Multiple Imputation, 1987, without the
    small-sample term). The column is the one with the most evidence. `rounds` of the search: fewer
    stay nearer.
    """
    starts = column.array + rng.normal(size=(SEARCHES, 8)) * PLUMES.steps_in(views.unit)
    starts[0] = column.array
    columns, _ = random_search(
        partial(column_evidence, views), Columns(starts), views.unit, rng, rounds=rounds
    )
    seen: list[tuple[PlumeColumn, AxisEstimate]] = []
    for each in columns:
        refined = refine_axis(views, each, seen[0][1].sway.hypotheses if seen else ())
        if refined is not None:
            seen.append(refined)
    if not seen:
        return None
    seen = [seen[k] for k in np.flatnonzero(mark_consistent([axis for _, axis in seen]))]
    nats = column_evidence(views, Columns.of([each for each, _ in seen]))
    seen = [seen[k] for k in np.argsort(-nats, kind="stable")]
    return seen[0][0], average_axes([axis for _, axis in seen])


def refine_axis(
    views: Views, column: PlumeColumn, hypotheses: Sequence[SwayHypothesis] = ()
) -> tuple[PlumeColumn, AxisEstimate] | None:
    """Measures the axis and solves for it in turns; None where too few views see it.

    The sway is searched for among these (nothing: all), then among what is left of them.
    """
    axis = None
    for _ in range(REFINEMENTS):
        sightings = sight_axis(views, column)
        origin = locate_base(views, column).height
        axis = estimate_axis(
            views.trajectory, column, sightings, views.unit, origin=origin, hypotheses=hypotheses
        )
        if axis is None:
            return None
        hypotheses = axis.sway.hypotheses
        column = column.on_line(axis.line)
    return None if axis is None else (column, axis)


def locate_source(
    views: Views, column: PlumeColumn, axis: AxisEstimate
) -> tuple[FloatArray, FloatArray]:
    """(3,) source and its (3, 3) covariance.

    An axis a little aside may meet another surface, or none; so the base is sought along several
    lines that the sightings allow.
    """
    candidates = [column.on_line(line) for line in axis.cubature_lines()]
    bases = [locate_base(views, candidate) for candidate in candidates]
    heights = np.array([[base.height] for base in bases])
    points = Columns.of(candidates).axis_points(heights)[:, 0]
    along = float(np.mean([base.sigma**2 for base in bases]))
    covariance = np.cov(points.T, bias=True) + along * np.outer(axis.rise, axis.rise)
    return points.mean(axis=0), covariance


def measure_plume(
    views: Views, column: PlumeColumn, axis: AxisEstimate, false_alarm: float
) -> Plume:
    """The plume that a column with this axis is."""
    base = locate_base(views, column)
    source, covariance = locate_source(views, column, axis)
    heights = np.linspace(base.evidence_low, base.evidence_high, RADIUS_SAMPLES)
    radii = column.radii_at(heights)
    distances = (heights - (source[2] - axis.lowest)) * np.linalg.norm(axis.rise)
    saw = score_columns(views, column.as_columns)[:, 0] > VIEW_SAW_NATS
    return Plume(
        id=0,
        source=source,
        source_covariance=covariance,
        axis=axis.direction,
        axis_sigma_rad=axis.direction_sigma_rad,
        extent_low=float(distances[0]),
        extent_high=float(distances[-1]),
        radius_by_height=np.column_stack([distances, radii]),
        evidence_nats=float(column_evidence(views, column.as_columns)[0]),
        probability=1 - false_alarm,
        views=tuple(int(index) for index in views.trajectory.indices[saw]),
        displacement_px=_mean_displacement_px(views, column, np.flatnonzero(saw)),
        source_hidden=base.hidden,
        refractive_index=REFRACTIVE_INDEX[find_bending_sign(views, column.on_line(axis.line))],
    )


def _mean_displacement_px(views: Views, column: PlumeColumn, rows: IntArray) -> float:
    """Mean displacement along the axis in the views of these rows, px of the original frames.

    0 where no row shows it.
    """
    heights = np.linspace(0, column.height, RADIUS_SAMPLES)
    points = column.axis_points(heights)
    height, width = views.llr.shape[1:]
    values = [np.empty((0, 2))]
    for i in rows:
        pixel = views.trajectory.project(int(i), points)
        pixel = np.rint(pixel[np.isfinite(pixel).all(axis=1)]).astype(int)
        inside = ((pixel >= 0) & (pixel < [width, height])).all(axis=1)
        values.append(views.displacement[i][pixel[inside, 1], pixel[inside, 0]])
    sizes = np.linalg.norm(np.concatenate(values), axis=1)
    return float(sizes.mean()) if len(sizes) else 0.0
