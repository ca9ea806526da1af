"""The axis of a column measured in each view: where, across it, the plume lies."""

from dataclasses import dataclass

import numpy as np

from geometry.arrays import FloatArray, FloatMap, IntArray
from locate.fusion.axis.profile import AxisProfile, measure_profile
from locate.fusion.search.columns import PlumeColumn
from locate.fusion.search.score import score_columns, supporting_pixels
from locate.fusion.views import Views

HEIGHTS, SECTIONS = 6, (0.0, 0.07, 0.15, 0.25, 0.37, 0.5, 0.7, 1.0)
"""Rows sampled per section, and where sections begin and end, in heights of the column: finer near
its base, set on the plants by which it was developed (docs/archive/tried.md)."""
VIEW_SAW_NATS = 0.5
"""Evidence from which on a view shows a column; chosen by hand."""
AGREEING_SHARE, FEWEST_AGREEING = 0.9, 4
"""Share and number of the views that must agree on how light is bent; chosen by hand."""
CORE_PERCENTILE, FEWEST_COVERED = 80, 20
"""Of the bending inside a column, from which on a pixel counts whole, and the pixels that takes;
set on
the same plants."""


@dataclass(frozen=True, kw_only=True)
class AxisSightings:
    """N sightings of the axis, each of one section in one view.

    Attributes:
        view: (N,) row of the view.
        time_s: (N,) when it was taken.
        height: (N,) middle of the section above the column's lowest point, along world Z.
        offset_px: (N,) from the projected axis to where the view sees it, along the normal.
        sigma_px: (N,) its standard deviation, as the evidence itself states it.
        by_shift: (N, 2) derivative of the offset by the axis point's world X and Y.
        by_pose: (N, 6) derivative by the view's pose, in gtsam's tangent of world_from_cam.
        bending_sign: (N,) 1 where the plume bends light away from its axis, -1 where towards it.
    """

    view: IntArray
    time_s: FloatArray
    height: FloatArray
    offset_px: FloatArray
    sigma_px: FloatArray
    by_shift: FloatArray
    by_pose: FloatArray
    bending_sign: IntArray

    def __len__(self) -> int:
        return len(self.view)


def sight_axis(views: Views, column: PlumeColumn, bending_sign: int = 0) -> AxisSightings:
    """Finds the axis across each section of the column in each view; see `AxisProfile`.

    A section without evidence for a plume gives no sighting.

    Args:
        views: The evidence.
        column: The column.
        bending_sign: As of `AxisSightings`, where it is known; 0: as these views show it.
    """
    profiles = _measure_profiles(views, column)
    if bending_sign == 0:
        bending_sign = 1 if sum(profile.reversal_near_axis for _, profile in profiles) >= 0 else -1
    located = [(i, profile, profile.locate_axis(bending_sign)) for i, profile in profiles]
    found = [(i, profile, place) for i, profile, place in located if place is not None]
    view = np.array([i for i, _, _ in found], dtype=np.int64)
    places = np.reshape([place for _, _, place in found], (-1, 2))
    derivatives = np.reshape([profile.derivatives for _, profile, _ in found], (-1, 8))
    return AxisSightings(
        view=view,
        time_s=views.trajectory.times_s[view],
        height=np.array([profile.height for _, profile, _ in found]),
        offset_px=places[:, 0],
        sigma_px=places[:, 1],
        by_shift=derivatives[:, :2],
        by_pose=derivatives[:, 2:],
        bending_sign=np.full(len(found), bending_sign),
    )


def find_bending_sign(views: Views, column: PlumeColumn) -> int:
    """1 where the column bends light away from its axis, -1 where towards it.

    0 where too few views show it, or fewer than nine in ten agree.
    """
    by_view: dict[int, float] = {}
    for i, profile in _measure_profiles(views, column):
        by_view[i] = by_view.get(i, 0.0) + profile.reversal_near_axis
    turns = np.array(list(by_view.values()))
    for sign in (1, -1):
        alike = np.count_nonzero(sign * turns > 0)
        if alike >= max(FEWEST_AGREEING, AGREEING_SHARE * len(turns)):
            return sign
    return 0


def _measure_profiles(views: Views, column: PlumeColumn) -> list[tuple[int, AxisProfile]]:
    """Every section of the column in each view that saw it, with the row of the view."""
    core = _core_evidence(views, column)
    middles = (np.arange(HEIGHTS) + 0.5) / HEIGHTS
    low, high = np.array(SECTIONS[:-1])[:, None], np.array(SECTIONS[1:])[:, None]
    sections = column.height * (low + (high - low) * middles)
    saw = np.flatnonzero(score_columns(views, column.as_columns)[:, 0] > VIEW_SAW_NATS)
    profiles = [
        (int(i), measure_profile(views, core, int(i), column, heights))
        for i in saw
        for heights in sections
    ]
    return [(i, profile) for i, profile in profiles if profile is not None]


def _core_evidence(views: Views, column: PlumeColumn) -> FloatMap:
    """(V, H, W) the evidence, less of it where light is bent less than in most of the column.

    Around a strong plume light is bent a little, far to one side: evidence for refraction as much
    as that in the middle, but not where the axis is.
    """
    inside = supporting_pixels(views, column)
    llr = views.llr.copy()
    for i in np.flatnonzero(inside.sum(axis=(1, 2)) >= FEWEST_COVERED):
        most = np.percentile(views.bending_px[i][inside[i]], CORE_PERCENTILE)
        if most > 0:
            share = np.minimum(1, views.bending_px[i] / most)
            llr[i] = np.where(llr[i] > 0, llr[i] * share, llr[i])
    return llr
