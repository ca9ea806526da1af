"""The next best view: the pose that would make the sources most certain."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from geometry.arrays import FloatArray
from geometry.camera import Camera
from geometry.grid import lever_gate
from locate.map.plume import Plume

SWAY_SHARE = 0.35
"""Sigma of a view across the axis, as a share of the plume's radius: its sway (chosen)."""
ALONG_TO_ACROSS = 3.0
"""Sigma along the axis over that across (chosen)."""
LEAST_SIGMA_PX = 1.0
"""Smallest sigma across the axis (chosen)."""
NOISE_PX = 0.1
"""Displacement at which a view counts for half (chosen)."""
SECTIONS = 7
"""Points along the axis at which visibility is checked."""
WINDOW_SHARE = 0.06
"""Half side of the window around such a point, as a share of the image width (chosen)."""
FEWEST_POINTS = 3
"""Background points in that window below which it counts as unknown (chosen)."""
UNKNOWN_GATE = 0.3
"""Lever gate before an unknown background (chosen)."""
COVERED_SHARE = 0.5
"""Share of the window's cells with nearer points, above which the plume is covered (chosen)."""
COVERED_DEPTH = 0.9
"""A point is nearer than the plume below this share of the plume's depth (chosen)."""
CELLS = 4
"""Cells along a side of the window."""


@dataclass(frozen=True, kw_only=True)
class ViewSuggestion:
    """What a view from one pose would gain.

    Attributes:
        index: Of the pose among those offered.
        gain_m: By how much the sources' 1-sigma radii would shrink, all plumes together, m.
        sigma_m: 1-sigma radius of the source that would be least certain afterwards, m.
        displacement_px: What the plume that gains most is expected to show; 0 where none would.
    """

    index: int
    gain_m: float
    sigma_m: float
    displacement_px: float


def rank_poses(
    plumes: Sequence[Plume],
    background_in_world: FloatArray,
    camera: Camera,
    poses: Sequence[FloatArray],
) -> list[ViewSuggestion]:
    """The poses, best first.

    Args:
        plumes: With the covariances that the factor graph gives their sources.
        background_in_world: (N, 3) points of the scene: they cover a plume, or stand behind it.
        camera: The pinhole.
        poses: (4, 4) world_from_cam each, those that the robot can reach.
    """
    ranked = [
        _evaluate_pose(index, plumes, background_in_world, camera, np.asarray(pose, dtype=float))
        for index, pose in enumerate(poses)
    ]
    return sorted(ranked, key=lambda suggestion: -suggestion.gain_m)


def _evaluate_pose(
    index: int,
    plumes: Sequence[Plume],
    background_in_world: FloatArray,
    camera: Camera,
    world_from_cam: FloatArray,
) -> ViewSuggestion:
    cam_from_world = np.asarray(np.linalg.inv(world_from_cam), dtype=float)
    background = _transform_points(cam_from_world, background_in_world)
    gains, after, shown = [0.0], [0.0], [0.0]
    for plume in plumes:
        gate = _visible_share(plume, background, camera, cam_from_world)
        displacement_px = gate * plume.displacement_px
        expected = _covariance_after(plume, camera, cam_from_world, displacement_px)
        gains.append(_sigma_radius(plume.source_covariance) - _sigma_radius(expected))
        after.append(_sigma_radius(expected))
        shown.append(displacement_px)
    return ViewSuggestion(
        index=index,
        gain_m=sum(gains),
        sigma_m=max(after),
        displacement_px=shown[int(np.argmax(gains))],
    )


def _sigma_radius(covariance: FloatArray) -> float:
    return float(np.sqrt(np.trace(covariance)))


def _transform_points(target_from_source: FloatArray, points: FloatArray) -> FloatArray:
    return np.asarray(points @ target_from_source[:3, :3].T + target_from_source[:3, 3])


def _covariance_after(
    plume: Plume, camera: Camera, cam_from_world: FloatArray, displacement_px: float
) -> FloatArray:
    """(3, 3) of the source once this view has been taken, m squared.

    A view measures where the axis lies across itself, to about a third of the plume's radius for
    its sway, and, less surely, where along itself it begins. A plume that shows little against
    the noise counts for little.
    """
    in_cam = _transform_points(cam_from_world, plume.source[None])[0]
    along = cam_from_world[:3, :3] @ plume.axis
    pixel = camera.project(in_cam)
    inside = np.all((pixel >= 0) & (pixel < [camera.width, camera.height]))
    if not inside or displacement_px == 0:
        return plume.source_covariance
    x, y, z = in_cam
    projection = camera.focal_px / z * np.array([[1, 0, -x / z], [0, 1, -y / z]])
    tangent = projection @ along
    length = float(np.linalg.norm(tangent))
    if length < 1e-9:
        return plume.source_covariance
    tangent /= length
    radius_px = camera.focal_px * float(plume.radius_by_height[0, 1]) / z
    sigma_px = max(SWAY_SHARE * radius_px, LEAST_SIGMA_PX)
    across = np.array([-tangent[1], tangent[0]])
    information = np.outer(across, across) / sigma_px**2
    information += np.outer(tangent, tangent) / (ALONG_TO_ACROSS * sigma_px) ** 2
    measured_share = displacement_px**2 / (displacement_px**2 + NOISE_PX**2)
    jacobian = projection @ cam_from_world[:3, :3]
    gained = measured_share * jacobian.T @ information @ jacobian
    return np.asarray(np.linalg.inv(np.linalg.inv(plume.source_covariance) + gained))


def _visible_share(
    plume: Plume, background_in_cam: FloatArray, camera: Camera, cam_from_world: FloatArray
) -> float:
    """Mean over the axis of the lever gate, 0 where it is outside the frame or covered."""
    distances = np.linspace(max(plume.extent_low, 0), plume.extent_high, SECTIONS)
    in_cam = _transform_points(cam_from_world, plume.points_on_axis(distances))
    pixels = camera.project(in_cam)
    inside = np.all((pixels >= 0) & (pixels < [camera.width, camera.height]), axis=1)
    behind = camera.project(background_in_cam)
    known = np.isfinite(behind).all(axis=1)
    behind, depths = behind[known], background_in_cam[known, 2]
    shares = [
        _point_gate(behind, depths, pixel, float(depth), WINDOW_SHARE * camera.width)
        if ahead
        else 0.0
        for pixel, depth, ahead in zip(pixels, in_cam[:, 2], inside, strict=True)
    ]
    return float(np.mean(shares))


def _point_gate(
    pixels: FloatArray, depths: FloatArray, pixel: FloatArray, depth: float, window_px: float
) -> float:
    """The lever gate of a point before the scene's points around its pixel.

    The window is cut into cells, for nearer surfaces have no fewer points to the cell than
    farther ones, but fewer to the pixel.
    """
    offset = (pixels - pixel) / window_px
    around = np.abs(offset).max(axis=1) < 1
    if around.sum() < FEWEST_POINTS:
        return UNKNOWN_GATE
    cells = np.floor((offset[around] + 1) * CELLS / 2).astype(int) @ [CELLS, 1]
    nearer = depths[around] < COVERED_DEPTH * depth
    if len(np.unique(cells[nearer])) > COVERED_SHARE * len(np.unique(cells)):
        return 0.0
    inverse_depth = np.float32(1 / np.median(depths[around][~nearer]))
    return float(lever_gate(np.array([depth], np.float32), np.array([inverse_depth]))[0])
