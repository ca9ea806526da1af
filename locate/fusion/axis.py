"""The axis of a column measured in each view: where, across it, the evidence lies."""

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
FEWEST_TO_FIT = 3
ROBUST_TURNS = 4


@dataclass(frozen=True, kw_only=True)
class AxisSightings:
    """Where each view sees the axis, section by section.

    Attributes:
        heights: (S,) middles of the sections above the column's lowest point, along world Z.
        points: (S, 3) of the column's axis at these heights, world units.
        pixel: (V, S, 2) where the view sees the axis; NaN where it does not.
        normal: (V, S, 2) unit normal of the projected axis: the direction that was measured.
        residual_px: (V, S) what is left of the distance between `pixel` and the projected axis
            once each section may stand where it fits best: the sway and the noise.
    """

    heights: FloatArray
    points: FloatArray
    pixel: FloatArray
    normal: FloatArray
    residual_px: FloatArray


def sight_axis(views: Views, column: FloatArray) -> AxisSightings:
    """Matches, across the axis, each section's evidence with the outline of the column.

    The offset is that of the outline which holds the most evidence; a centroid would be drawn
    to wherever its window stands.
    """
    middles = (np.arange(HEIGHTS) + 0.5) / HEIGHTS
    low, high = np.array(SECTIONS[:-1])[:, None], np.array(SECTIONS[1:])[:, None]
    sections = column[HEIGHT] * (low + (high - low) * middles)
    heights = sections.mean(axis=1)
    points = spine(column[None], heights[None])[0]
    saw = score(views, column[None])[:, 0] > VIEW_SAW_NATS
    normal = np.zeros((len(views), len(sections), 2))
    offset = np.full((len(views), len(sections)), np.nan)
    for i in np.flatnonzero(saw):
        for k, section in enumerate(sections):
            offset[i, k], normal[i, k] = _match(views, int(i), column, section)
    projected = np.stack([views.trajectory.project(i, points) for i in range(len(views))])
    return AxisSightings(
        heights=heights,
        points=points,
        pixel=projected + offset[..., None] * normal,
        normal=normal,
        residual_px=_residuals(views, points, normal, offset),
    )


def _residuals(
    views: Views, points: FloatArray, normal: FloatArray, offset: FloatArray
) -> FloatArray:
    """(V, S) offsets less those that moving each point sideways explains, by robust regression."""
    nudge = 1e-3 * views.unit
    residual = np.full_like(offset, np.nan)
    for k, point in enumerate(points):
        seen = np.flatnonzero(np.isfinite(offset[:, k]))
        if len(seen) < FEWEST_TO_FIT:
            continue
        places = point + nudge * np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]])
        pixels = np.stack([views.trajectory.project(int(i), places) for i in seen])
        moved = (pixels[:, 1:] - pixels[:, :1]) / nudge
        design = np.einsum("vdk,vk->vd", moved, normal[seen, k])
        row, weight = offset[seen, k], np.ones(len(seen))
        for _ in range(ROBUST_TURNS):
            root = np.sqrt(weight)
            shift = np.linalg.lstsq(design * root[:, None], row * root, rcond=None)[0]
            left = row - design @ shift
            weight = 1 / (1 + (left / (2 * np.median(np.abs(left)) + 1e-9)) ** 2)
        residual[seen, k] = left
    return residual


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
