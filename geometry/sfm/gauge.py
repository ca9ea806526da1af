"""A world frame for a reconstruction that has none: a guess of up, a tame origin, a tame scale."""

import numpy as np

from geometry.arrays import FloatArray
from geometry.similarity import Similarity
from geometry.trajectory import Trajectory

VIEW_DISTANCE = 10.0
MAX_TILT_DEG = 35.0
PLANE_TRIALS = 400
PLANE_TOLERANCE = 0.02
MIN_PLANE_SHARE = 0.15
MIN_SURVEY_TURN = 0.5
MIN_SURVEY_ASPECT = 0.25
SEED = 0


def normalising_transform(
    trajectory: Trajectory, points_in_world: FloatArray, view_distance: float
) -> tuple[Similarity, str]:
    """``scene_from_world``: Z up as a guess, origin in the points, cameras 10 units from them.

    Up is the normal of the plane most points lie on, or the mean up axis of the cameras where that
    plane is more than `MAX_TILT_DEG` off it (a wall) or holds too few points.

    Args:
        trajectory: In the world frame of the reconstruction.
        points_in_world: (M, 3) sparse points.
        view_distance: Median distance from the cameras to the points they see, world units.

    Returns:
        The transform, and what up was taken from: ``"plane"`` or ``"camera"``.
    """
    camera_up = -trajectory.rotations[:, 1, :].mean(axis=0)
    camera_up /= max(float(np.linalg.norm(camera_up)), 1e-9)
    forward = trajectory.rotations[:, 2, :].mean(axis=0)
    up, source = camera_up, "camera"
    normal, share = dominant_plane(points_in_world, PLANE_TOLERANCE * view_distance)
    normal = normal * (1.0 if _side(normal, camera_up, forward) >= 0 else -1.0)
    tilt_deg = float(np.degrees(np.arccos(np.clip(normal @ camera_up, -1, 1))))
    if share >= MIN_PLANE_SHARE and (tilt_deg <= MAX_TILT_DEG or _looks_down(normal, trajectory)):
        up, source = normal, "plane"
    rotation = _rotation_with_z(up, forward)
    scale = VIEW_DISTANCE / view_distance
    translation = -scale * rotation @ np.median(points_in_world, axis=0)
    return Similarity(scale=scale, rotation=rotation, translation=translation), source


def dominant_plane(points: FloatArray, tolerance: float) -> tuple[FloatArray, float]:
    """Unit normal of the plane with most points within `tolerance`, and their share (RANSAC)."""
    if len(points) < 10:
        return np.array([0.0, 0.0, 1.0]), 0.0
    random = np.random.default_rng(SEED)
    triples = points[random.integers(len(points), size=(PLANE_TRIALS, 3))]
    normals = np.cross(triples[:, 1] - triples[:, 0], triples[:, 2] - triples[:, 0])
    lengths = np.linalg.norm(normals, axis=1)
    usable = lengths > 1e-12 * max(float(lengths.max()), 1e-300)
    if not usable.any():
        return np.array([0.0, 0.0, 1.0]), 0.0
    normals, anchors = normals[usable] / lengths[usable, None], triples[usable, 0]
    distances = np.abs(points @ normals.T - np.einsum("ij,ij->i", normals, anchors))
    best = int(np.argmax((distances < tolerance).sum(axis=0)))
    inside = points[distances[:, best] < tolerance]
    _, _, axes = np.linalg.svd(inside - inside.mean(axis=0), full_matrices=False)
    return np.asarray(axes[2]), len(inside) / len(points)


def _side(normal: FloatArray, camera_up: FloatArray, forward: FloatArray) -> float:
    """Positive where `normal` points up: with the cameras' up, or against a view from above."""
    along_up = float(normal @ camera_up)
    return along_up if abs(along_up) > 0.3 else -float(normal @ forward)


def _looks_down(normal: FloatArray, trajectory: Trajectory) -> bool:
    """A survey from above: every camera looks straight at the plane, whatever its own up axis.

    A wall seen head-on looks the same, but people walk along it: the centres then lie on a line
    of the plane, while a survey covers an area of it or turns between its strips.
    """
    views = trajectory.rotations[:, 2, :] @ normal
    if float(np.median(views)) > -np.cos(np.radians(MAX_TILT_DEG)):
        return False
    headings = trajectory.rotations[:, 0, :]
    turn = float(np.sqrt(((headings - headings.mean(axis=0)) ** 2).sum(axis=1).mean()))
    centers = trajectory.centers_in_world - trajectory.centers_in_world.mean(axis=0)
    in_plane = centers - np.outer(centers @ normal, normal)
    spread = np.linalg.svd(in_plane, compute_uv=False)
    return turn > MIN_SURVEY_TURN or bool(spread[1] > MIN_SURVEY_ASPECT * spread[0])


def _rotation_with_z(up: FloatArray, forward: FloatArray) -> FloatArray:
    """scene_from_world with Z along `up` and Y along the horizontal part of `forward`."""
    y = forward - (forward @ up) * up
    if np.linalg.norm(y) < 1e-6:
        y = np.cross(up, [1.0, 0.0, 0.0] if abs(up[0]) < 0.9 else [0.0, 1.0, 0.0])
    y /= np.linalg.norm(y)
    return np.stack([np.cross(y, up), y, up])
