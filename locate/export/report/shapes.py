"""Surfaces and wires of the 3D scene, as plain arrays."""

import numpy as np

from geometry.arrays import FloatArray, IntArray
from geometry.trajectory import Trajectory
from locate.map.plume import Plume

AROUND = 32
"""Vertices around a surface."""


def camera_frusta(trajectory: Trajectory, rows: IntArray, size: float) -> FloatArray:
    """(K, 3) polyline of the camera pyramids of the given rows, NaN between strokes.

    Args:
        trajectory: The cameras.
        rows: Which of them to draw.
        size: Depth of a pyramid in world units.
    """
    camera = trajectory.camera
    right, bottom = camera.width - 1.0, camera.height - 1.0
    rays = camera.rays([[0.0, 0.0], [right, 0.0], [right, bottom], [0.0, bottom]])
    corners = size * rays / rays[:, 2:]
    apex, gap = np.zeros(3), np.full(3, np.nan)
    strokes = [*corners, corners[0], gap]
    for corner in corners:
        strokes += [apex, corner, gap]
    wire = np.array(strokes)
    centers = trajectory.centers_in_world
    return np.concatenate([wire @ trajectory.rotations[i] + centers[i] for i in rows])


def plume_surface(plume: Plume) -> tuple[FloatArray, IntArray]:
    """The surface of a plume: vertices (V, 3) and triangles (T, 3)."""
    heights, radii = plume.radius_by_height.T
    side, other = _perpendicular_axes(plume.axis)
    angle = np.linspace(0, 2 * np.pi, AROUND, endpoint=False)
    circle = np.cos(angle)[:, None] * side + np.sin(angle)[:, None] * other
    rings = plume.points_on_axis(heights)[:, None] + radii[:, None, None] * circle
    return rings.reshape(-1, 3), _ring_triangles(len(heights))


def ellipsoid_surface(
    center: FloatArray, covariance: FloatArray, n_sigma: float
) -> tuple[FloatArray, IntArray]:
    """The surface `n_sigma` from `center`: vertices (V, 3) and triangles (T, 3)."""
    variances, axes = np.linalg.eigh(covariance)
    polar = np.linspace(0, np.pi, AROUND // 2 + 1)[:, None]
    angle = np.linspace(0, 2 * np.pi, AROUND, endpoint=False)
    ball = np.stack(
        [
            np.sin(polar) * np.cos(angle),
            np.sin(polar) * np.sin(angle),
            np.cos(polar) * np.ones(AROUND),
        ],
        axis=-1,
    )
    stretched = n_sigma * ball.reshape(-1, 3) * np.sqrt(np.maximum(variances, 0.0))
    return center + stretched @ axes.T, _ring_triangles(len(polar))


def _perpendicular_axes(axis: FloatArray) -> tuple[FloatArray, FloatArray]:
    least = np.eye(3)[np.argmin(np.abs(axis))]
    side = np.cross(axis, least)
    side /= np.linalg.norm(side)
    return side, np.cross(axis, side)


def _ring_triangles(rings: int) -> IntArray:
    """Triangles between `rings` rings of AROUND vertices."""
    here = np.arange((rings - 1) * AROUND)
    beside = here - here % AROUND + (here + 1) % AROUND
    lower = np.stack([here, beside, here + AROUND], axis=-1)
    upper = np.stack([beside, beside + AROUND, here + AROUND], axis=-1)
    return np.concatenate([lower, upper])
