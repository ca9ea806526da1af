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

HEIGHTS = 16
REACH_RADII = 2.5
PROFILE_SAMPLES = 81
SEARCH_RADII = 1.6
VIEW_SAW_NATS = 0.5
LEAST_RADIUS_PX = 2.0
ENDS_FROM_HALVES = np.array([[1.5, -0.5], [-0.5, 1.5]])


@dataclass(frozen=True, kw_only=True)
class AxisSightings:
    """Where each view sees the axis, at two points of it: its lowest and its highest.

    Both are drawn through the middles of the lower and the upper half, which are measured: a
    plume that sways shifts its halves against each other, so their errors are correlated, and
    only the scatter of the drawn points themselves says how sure a source at the base can be.

    Attributes:
        heights: (2,) of the points above the column's lowest point, along world Z.
        points: (2, 3) of the axis itself at these heights, world units.
        pixel: (V, 2, 2) where the view sees the axis; NaN where it does not.
        normal: (V, 2, 2) unit normal of the projected axis: the direction that was measured.
        offset_px: (V, 2) distance of `pixel` from the projected axis along `normal`.
    """

    heights: FloatArray
    points: FloatArray
    pixel: FloatArray
    normal: FloatArray
    offset_px: FloatArray


def sight_axis(views: Views, column: FloatArray) -> AxisSightings:
    """Matches, across the axis, each half's evidence with the outline of the column.

    The offset is that of the outline which holds the most evidence; a centroid would be drawn
    to wherever its window stands.
    """
    heights = column[HEIGHT] * (np.arange(HEIGHTS) + 0.5) / HEIGHTS
    halves = heights.reshape(2, -1)
    nodes = np.array([0.0, column[HEIGHT]])
    points = spine(column[None], nodes[None])[0]
    saw = score(views, column[None])[:, 0] > VIEW_SAW_NATS
    normal = np.zeros((len(views), 2, 2))
    offset = np.full((len(views), 2), np.nan)
    for i in np.flatnonzero(saw):
        for node, half in enumerate(halves):
            offset[i, node], normal[i, node] = _match(views, int(i), column, half)
    offset = offset @ ENDS_FROM_HALVES.T
    projected = np.stack([views.trajectory.project(i, points) for i in range(len(views))])
    return AxisSightings(
        heights=nodes,
        points=points,
        pixel=projected + offset[..., None] * normal,
        normal=normal,
        offset_px=offset,
    )


def _match(
    views: Views, i: int, column: FloatArray, heights: FloatArray
) -> tuple[float, FloatArray]:
    """Offset in px (NaN where there is none) and normal of one half of the axis in one view."""
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
