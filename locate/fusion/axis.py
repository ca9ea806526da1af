"""The axis of a column measured in each view: where, across it, the evidence lies."""

import warnings
from dataclasses import dataclass

import cv2
import numpy as np

from geometry.arrays import FloatArray
from geometry.grid import lever_gate
from locate.fusion.column import (
    FOOTPRINT_SHARE,
    HEIGHT,
    NEAREST_DEPTH_UNITS,
    OPENING,
    RADIUS,
    axis_direction,
    score,
    spine,
)
from locate.fusion.views import Views

HEIGHTS, SECTIONS = 6, (0.0, 0.15, 0.35, 0.6, 1.0)
REACH_RADII = 2.5
PROFILE_SAMPLES = 81
SEARCH_RADII = 1.6
VIEW_SAW_NATS = 0.5
LEAST_RADIUS_PX = 2.0
SMALLEST_SCATTER_PX = 0.5
FEWEST_SECTIONS = 2
BEND = 0.15


@dataclass(frozen=True, kw_only=True)
class AxisSightings:
    """Where each view sees the axis, at two points of it: its lowest and its highest.

    Both lie on the line through what the view measured in the sections of the axis. A plume that
    sways shifts its sections against each other, the upper ones most, so only the scatter of the
    drawn points themselves says how sure a source at the base can be.

    Attributes:
        heights: (2,) of the points above the column's lowest point, along world Z.
        points: (2, 3) of the axis itself at these heights, world units.
        pixel: (V, 2, 2) where the view sees the axis; NaN where it does not.
        normal: (V, 2, 2) unit normal of the projected axis: the direction that was measured.
        offset_px: (V, 2) distance of `pixel` from the projected axis along `normal`.
        section_px: (V, S) the measured offsets of the sections, lowest first, NaN where unseen.
    """

    heights: FloatArray
    points: FloatArray
    pixel: FloatArray
    normal: FloatArray
    offset_px: FloatArray
    section_px: FloatArray


def sight_axis(views: Views, column: FloatArray) -> AxisSightings:
    """Matches, across the axis, each section's evidence with the outline of the column.

    The offset is that of the outline which holds the most evidence; a centroid would be drawn
    to wherever its window stands.
    """
    middles = (np.arange(HEIGHTS) + 0.5) / HEIGHTS
    low, high = np.array(SECTIONS[:-1])[:, None], np.array(SECTIONS[1:])[:, None]
    sections = column[HEIGHT] * (low + (high - low) * middles)
    ends = np.array([0.0, column[HEIGHT]])
    points = spine(column[None], ends[None])[0]
    saw = score(views, column[None])[:, 0] > VIEW_SAW_NATS
    normal = np.zeros((len(views), len(sections), 2))
    offset = np.full((len(views), len(sections)), np.nan)
    for i in np.flatnonzero(saw):
        for k, heights in enumerate(sections):
            offset[i, k], normal[i, k] = _match(views, int(i), column, heights)
    projected = np.stack([views.trajectory.project(i, points) for i in range(len(views))])
    length_px = np.nanmedian(np.linalg.norm(projected[:, 1] - projected[:, 0], axis=-1))
    drawn = _draw_lines(sections.mean(axis=1), offset, ends, BEND * length_px / ends[1])
    end_normal = normal[:, [0, -1]]
    return AxisSightings(
        heights=ends,
        points=points,
        pixel=projected + drawn[..., None] * end_normal,
        normal=end_normal,
        offset_px=drawn,
        section_px=offset,
    )


def _draw_lines(
    heights: FloatArray, offset: FloatArray, ends: FloatArray, bend_px: float
) -> FloatArray:
    """(V, 2) each view's offsets (V, S) at (S,) heights, drawn as a line to the two ends.

    Sections that scatter much between views weigh little, and so do high ones: a plume bends
    away from the line in which it sets out, by about `bend_px` per unit of height.
    """
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)
        median = np.nanmedian(offset, axis=0)
        scatter = 1.4826 * np.nanmedian(np.abs(offset - median), axis=0)
    scatter = np.nan_to_num(scatter, nan=np.inf)
    weight = 1 / (scatter**2 + SMALLEST_SCATTER_PX**2 + (bend_px * heights) ** 2)
    drawn = np.full((len(offset), 2), np.nan)
    for i, row in enumerate(offset):
        seen = np.isfinite(row)
        if seen.sum() >= FEWEST_SECTIONS:
            line = np.polynomial.Polynomial.fit(
                heights[seen], row[seen], deg=1, w=np.sqrt(weight[seen])
            )
            drawn[i] = line(ends)
    return drawn


def _match(
    views: Views, i: int, column: FloatArray, heights: FloatArray
) -> tuple[float, FloatArray]:
    """Offset in px (NaN where there is none) and normal of a section of the axis in one view."""
    camera, trajectory = views.trajectory.camera, views.trajectory
    points = spine(column[None], heights[None])[0]
    in_cam = trajectory.world_to_cam(i, points)
    depth = in_cam[:, 2]
    if (depth < NEAREST_DEPTH_UNITS * views.unit).any():
        return np.nan, np.zeros(2)
    pixel = camera.project(in_cam)
    ahead = camera.project(trajectory.world_to_cam(i, points + 1e-3 * axis_direction(column)))
    tangent = (ahead - pixel).mean(axis=0)
    tangent /= max(float(np.linalg.norm(tangent)), 1e-12)
    normal = np.array([-tangent[1], tangent[0]])
    radii_px = camera.focal_px * (column[RADIUS] + column[OPENING] * heights) / depth
    radii_px = np.maximum(radii_px, LEAST_RADIUS_PX)
    reach = np.linspace(-REACH_RADII, REACH_RADII, PROFILE_SAMPLES)
    sampled = pixel[:, None] + (radii_px[:, None] * reach)[..., None] * normal
    evidence = _sample(views, i, sampled, depth)
    width = np.abs(reach) <= FOOTPRINT_SHARE
    smooth = cv2.GaussianBlur(width.astype(np.float64)[None], (0, 0), 4)[0]
    matched = np.correlate((evidence * radii_px[:, None]).mean(axis=0), smooth, mode="same")
    searched = np.flatnonzero(np.abs(reach) <= SEARCH_RADII)
    best = int(searched[np.argmax(matched[searched])])
    if matched[best] <= 0 or best in (searched[0], searched[-1]):
        return np.nan, normal
    below, peak, above = matched[best - 1 : best + 2]
    curvature = below - 2 * peak + above
    shift = 0.5 * (below - above) / curvature if curvature < 0 else 0.0
    return float((reach[best] + shift * (reach[1] - reach[0])) * radii_px.mean()), normal


def _sample(views: Views, i: int, pixels: FloatArray, depth: FloatArray) -> FloatArray:
    """(S, P) gated evidence at (S, P, 2) pixels of axis points at (S,) depths; 0 outside."""
    x, y = pixels[..., 0].astype(np.float32), pixels[..., 1].astype(np.float32)
    llr = cv2.remap(views.llr[i], x, y, cv2.INTER_LINEAR, borderValue=0)
    background = cv2.remap(
        views.inverse_depth[i], x, y, cv2.INTER_NEAREST, borderValue=float("nan")
    )
    gate = lever_gate(depth[:, None].astype(np.float32), np.asarray(background, np.float32))
    return np.asarray(llr * gate, dtype=float)
