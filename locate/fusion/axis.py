"""The axis of a column sighted in each view: where, across it, the evidence lies."""

from dataclasses import dataclass, replace

import cv2
import numpy as np

from geometry.arrays import FloatArray, IntArray
from geometry.grid import lever_gate
from geometry.trajectory import Trajectory
from locate.fusion.column import (
    FOOTPRINT_SHARE,
    HEIGHT,
    NEAREST_DEPTH_UNITS,
    OPENING,
    RADIUS,
    axis_direction,
    covered,
    score,
    spine,
)
from locate.fusion.views import Views

HEIGHTS, SECTIONS = 6, (0.0, 0.07, 0.15, 0.25, 0.37, 0.5, 0.7, 1.0)
REACH_RADII = 2.5
PROFILE_SAMPLES = 101
EDGE_SAMPLES = 5
VIEW_SAW_NATS = 0.5
SECTION_SAW_LLR = 0.4
LOOK_PX2 = 10.0
LEAST_RADIUS_PX = 2.0
CORE_PERCENTILE, FEWEST_COVERED = 80, 20


@dataclass(frozen=True, kw_only=True)
class AxisSightings:
    """N sightings of the axis, each of one section in one view.

    Attributes:
        view: (N,) row of the view.
        time_s: (N,) when it was taken.
        height: (N,) middle of the section above the column's lowest point, along world Z.
        offset_px: (N,) from the projected axis to where the view sees it, along the normal.
        sigma_px: (N,) its standard deviation, as far as the evidence itself tells.
        by_shift: (N, 2) derivative of the offset by the axis point's world X and Y.
        by_pose: (N, 6) derivative by the view's pose, in gtsam's tangent of world_from_cam.
    """

    view: IntArray
    time_s: FloatArray
    height: FloatArray
    offset_px: FloatArray
    sigma_px: FloatArray
    by_shift: FloatArray
    by_pose: FloatArray

    def __len__(self) -> int:
        return len(self.view)


def sight_axis(views: Views, column: FloatArray) -> AxisSightings:
    """Matches, across the axis, each section's evidence with the outline of the column.

    The offset is that of the outline which holds the most evidence; a centroid would be drawn
    to wherever its window stands. Where the pixels there do not speak for a plume, nothing was
    sighted: silence before a contradicting background is no plume.
    """
    views = _core(views, column)
    middles = (np.arange(HEIGHTS) + 0.5) / HEIGHTS
    low, high = np.array(SECTIONS[:-1])[:, None], np.array(SECTIONS[1:])[:, None]
    sections = column[HEIGHT] * (low + (high - low) * middles)
    places: list[tuple[int, float]] = []
    measured: list[FloatArray] = []
    for i in np.flatnonzero(score(views, column[None])[:, 0] > VIEW_SAW_NATS):
        for heights in sections:
            sighted = _sight(views, int(i), column, heights)
            if sighted is not None:
                places.append((int(i), float(heights.mean())))
                measured.append(sighted)
    view = np.array([place[0] for place in places], dtype=np.int64)
    rows = np.reshape(measured, (-1, 10))
    return AxisSightings(
        view=view,
        time_s=views.trajectory.times_s[view],
        height=np.array([place[1] for place in places]),
        offset_px=rows[:, 0],
        sigma_px=rows[:, 1],
        by_shift=rows[:, 2:4],
        by_pose=rows[:, 4:],
    )


def _core(views: Views, column: FloatArray) -> Views:
    """The views with less evidence where light is bent less than in most of the column.

    Around a strong plume the air is bent little and far to one side, which speaks for refraction as
    much as the middle does, but is not where the axis is.
    """
    inside = covered(views, column)
    noise = np.minimum(views.sigma_px, views.displacement_px)
    size = np.sqrt(views.displacement_px**2 - noise**2)
    llr = views.llr.copy()
    for i in np.flatnonzero(inside.sum(axis=(1, 2)) >= FEWEST_COVERED):
        most = np.percentile(size[i][inside[i]], CORE_PERCENTILE)
        if most > 0:
            share = np.minimum(1, size[i] / most)
            llr[i] = np.where(llr[i] > 0, llr[i] * share, llr[i])
    return replace(views, llr=llr)


def _sight(views: Views, i: int, column: FloatArray, heights: FloatArray) -> FloatArray | None:
    """(10,) offset, its sigma and its derivatives; None where the section was not sighted."""
    points = spine(column[None], heights[None])[0]
    in_cam = views.trajectory.world_to_cam(i, points)
    depth = in_cam[:, 2]
    if (depth < NEAREST_DEPTH_UNITS * views.unit).any():
        return None
    camera = views.trajectory.camera
    pixel = camera.project(in_cam)
    normal = _normal(views.trajectory, i, points, column)
    radii_px = camera.focal_px * (column[RADIUS] + column[OPENING] * heights) / depth
    radii_px = np.maximum(radii_px, LEAST_RADIUS_PX)
    reach = np.linspace(-REACH_RADII, REACH_RADII, PROFILE_SAMPLES)
    sampled = pixel[:, None] + (radii_px[:, None] * reach)[..., None] * normal
    outline = (np.abs(reach) <= FOOTPRINT_SHARE).astype(float)
    outline = cv2.GaussianBlur(outline[None], (0, 0), EDGE_SAMPLES)[0]
    evidence = _sample(views, i, sampled, depth).mean(axis=0)
    llr = np.correlate(evidence, outline / outline.sum(), mode="same")
    searched = np.abs(reach) <= REACH_RADII - FOOTPRINT_SHARE
    offsets_px, llr = reach[searched] * radii_px.mean(), llr[searched]
    best = int(np.argmax(llr))
    if llr[best] < SECTION_SAW_LLR or best in (0, len(llr) - 1):
        return None
    length_px = float(np.linalg.norm(pixel[-1] - pixel[0])) * HEIGHTS / (HEIGHTS - 1)
    looks = 2 * FOOTPRINT_SHARE * radii_px.mean() * length_px / LOOK_PX2
    likelihood = np.exp(looks * (llr - llr[best]))
    variance = likelihood @ (offsets_px - offsets_px[best]) ** 2 / likelihood.sum()
    variance += (offsets_px[1] - offsets_px[0]) ** 2 / 12
    derivatives = _derivatives(views.trajectory, i, points.mean(axis=0), normal)
    return np.array([offsets_px[best], np.sqrt(variance), *derivatives])


def _normal(trajectory: Trajectory, i: int, points: FloatArray, column: FloatArray) -> FloatArray:
    """(2,) unit normal of the projected axis: the direction that is measured."""
    ahead = points + 1e-3 * axis_direction(column)
    tangent = (trajectory.project(i, ahead) - trajectory.project(i, points)).mean(axis=0)
    tangent /= max(float(np.linalg.norm(tangent)), 1e-12)
    return np.array([-tangent[1], tangent[0]])


def _derivatives(
    trajectory: Trajectory, i: int, point: FloatArray, normal: FloatArray
) -> FloatArray:
    """(8,) of the offset along `normal`: by the point's world X and Y, and by the pose.

    The tangent of world_from_cam turns and shifts in the camera's own frame, so a point in it
    moves by `p x omega - v`.
    """
    x, y, z = trajectory.world_to_cam(i, point[None])[0]
    by_cam = normal @ np.array([[1, 0, -x / z], [0, 1, -y / z]]) * trajectory.camera.focal_px / z
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    by_shift = by_cam @ trajectory.rotations[i][:, :2]
    return np.concatenate([by_shift, by_cam @ cross, -by_cam])


def _sample(views: Views, i: int, pixels: FloatArray, depth: FloatArray) -> FloatArray:
    """(S, P) gated evidence at (S, P, 2) pixels of axis points at (S,) depths; 0 outside."""
    x, y = pixels[..., 0].astype(np.float32), pixels[..., 1].astype(np.float32)
    llr = cv2.remap(views.llr[i], x, y, cv2.INTER_LINEAR, borderValue=0)
    background = cv2.remap(
        views.inverse_depth[i], x, y, cv2.INTER_NEAREST, borderValue=float("nan")
    )
    gate = lever_gate(depth[:, None].astype(np.float32), np.asarray(background, np.float32))
    return np.asarray(llr * gate, dtype=float)
