"""A world frame for a reconstruction that has none: a guess of up, a tame origin, a tame scale."""

import numpy as np

from geometry.arrays import FloatArray
from geometry.similarity import Similarity
from geometry.trajectory import Trajectory

VIEW_DISTANCE = 10.0
"""Median distance from cameras to points in the scene frame, scene units."""
MAX_TILT_DEG = 35.0
"""Largest angle between the ground's normal and the cameras' up axis; no wall is within it."""
MAX_SLOPE_DEG = 10.0
"""Largest angle between the ground's normal and up, where the cameras show that by themselves;
chosen by hand."""
LEVEL_SIGMA_DEG = 3.0
"""Standard deviation of that angle: of two planes with as many points the one nearer to up counts.
Set on 63 reconstructions of simulated plants, with rolls of 0 to 5 degrees added
(docs/archive/tried.md)."""
MAX_ROLL = 0.25
"""Of cameras that show up: rms of how far their x axes leave one plane, over their spread in it;
chosen by hand."""
PLANE_TRIALS = 400
"""Random triples of RANSAC."""
PLANE_TOLERANCE = 0.02
"""Distance from a plane at which a point lies on it, over the view distance."""
MIN_PLANE_SHARE = 0.1
"""Least share of the points on a ground plane."""
MIN_SURVEY_SHARE = 0.5
"""Least share of the points on the ground of a survey from above."""
MIN_SURVEY_TURN = 0.5
"""Rms spread of unit headings beyond which a survey turns between its strips."""
MIN_SURVEY_ASPECT = 0.25
"""Width over length of a survey's path, beyond which it covers an area."""
SEED = 0


def normalising_transform(
    trajectory: Trajectory, points_in_world: FloatArray, view_distance: float
) -> tuple[Similarity, str]:
    """``scene_from_world``: Z up as a guess, origin in the points, cameras 10 units from them.

    Up is the normal of the plane that most points lie on among those within `MAX_TILT_DEG` of the
    cameras' mean up axis (so no wall), that axis itself where such a plane holds too few points,
    or the normal of the plane straight below the cameras. Cameras that turn without rolling show
    up better than their mean axis, which leans as they look down: a plane counts for less the
    further its normal is from that (`LEVEL_SIGMA_DEG`), and for nothing beyond `MAX_SLOPE_DEG`.

    Args:
        trajectory: In the world frame of the reconstruction.
        points_in_world: (M, 3) sparse points.
        view_distance: Median distance from the cameras to the points they see, world units.

    Returns:
        The transform, and what up was taken from: ``"plane"``, ``"level"`` for cameras that turn
        without rolling, or ``"camera"`` for their mean axis.
    """
    camera_up = -trajectory.rotations[:, 1, :].mean(axis=0)
    camera_up /= max(float(np.linalg.norm(camera_up)), 1e-9)
    forward = trajectory.rotations[:, 2, :].mean(axis=0)
    level = _level_up(trajectory, camera_up)
    up, source = (camera_up, "camera") if level is None else (level, "level")
    tolerance = PLANE_TOLERANCE * view_distance
    tilt_deg, sigma_deg = (
        (MAX_TILT_DEG, np.inf) if level is None else (MAX_SLOPE_DEG, LEVEL_SIGMA_DEG)
    )
    ground, ground_share = dominant_plane(
        points_in_world, tolerance, near=up, tilt_deg=tilt_deg, sigma_deg=sigma_deg
    )
    below, below_share = dominant_plane(points_in_world, tolerance, near=-forward)
    if below_share >= MIN_SURVEY_SHARE and _looks_down(below, trajectory):
        up, source = below, "plane"
    elif ground_share >= MIN_PLANE_SHARE:
        up, source = ground, "plane"
    rotation = _rotation_with_z(up, forward)
    scale = VIEW_DISTANCE / view_distance
    translation = -scale * np.median(points_in_world @ rotation.T, axis=0)
    return Similarity(scale=scale, rotation=rotation, translation=translation), source


def dominant_plane(
    points: FloatArray,
    tolerance: float,
    near: FloatArray,
    *,
    tilt_deg: float = MAX_TILT_DEG,
    sigma_deg: float = np.inf,
) -> tuple[FloatArray, float]:
    """The plane with most points within `tolerance`, its normal within `tilt_deg` of `near`.

    RANSAC, then two fits to ever closer points. The points of a plane count for less the further
    its normal is from `near`, by a normal distribution of standard deviation `sigma_deg`.

    Returns:
        The unit normal on the side of `near`, and the share of points on the plane (0 for none).
    """
    if len(points) < 10:
        return near, 0.0
    random = np.random.default_rng(SEED)
    triples = points[random.integers(len(points), size=(PLANE_TRIALS, 3))]
    normals = np.cross(triples[:, 1] - triples[:, 0], triples[:, 2] - triples[:, 0])
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-300)
    along = np.abs(normals @ near) / max(float(np.linalg.norm(near)), 1e-9)
    usable = along > np.cos(np.radians(tilt_deg))
    if not usable.any():
        return near, 0.0
    normals, offsets = normals[usable], np.einsum("ij,ij->i", normals, triples[:, 0])[usable]
    counts = (np.abs(points @ normals.T - offsets) < tolerance).sum(axis=0)
    off_deg = np.degrees(np.arccos(np.minimum(along[usable], 1.0)))
    best = int(np.argmax(counts * np.exp(-((off_deg / sigma_deg) ** 2) / 2)))
    normal, offset = normals[best], float(offsets[best])
    for shrink in (1.0, 0.4):
        inside = points[np.abs(points @ normal - offset) < shrink * tolerance]
        if len(inside) >= 3:
            normal = np.linalg.svd(inside - inside.mean(axis=0), full_matrices=False)[2][2]
            offset = float(np.median(inside @ normal))
    return np.asarray(normal if normal @ near >= 0 else -normal), float(counts[best] / len(points))


def _level_up(trajectory: Trajectory, camera_up: FloatArray) -> FloatArray | None:
    """Up as the normal of the cameras' x axes, which people hold level (Brown and Lowe, IJCV 2007).

    None where the cameras roll, turn too little to tell, or stand on their side.
    """
    x_axes = trajectory.rotations[:, 0, :]
    spread, axes = np.linalg.eigh(x_axes.T @ x_axes / len(x_axes))
    up = axes[:, 0] * (1.0 if axes[:, 0] @ camera_up >= 0 else -1.0)
    rolling = np.sqrt(max(float(spread[0]), 0.0)) > MAX_ROLL * np.sqrt(max(float(spread[1]), 0.0))
    if rolling or up @ camera_up < np.cos(np.radians(MAX_TILT_DEG)):
        return None
    return np.asarray(up)


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
