"""Where the camera is at each frame."""

import numpy as np
from scipy.spatial.transform import Rotation

from geometry.arrays import FloatArray
from geometry.trajectory import Trajectory
from locate.simulation.scene import PathBlock, Scene

HAND_MOTION_HZ = (0.35, 0.8, 1.7)


def look_at(center: FloatArray, target: FloatArray) -> FloatArray:
    """The (3, 3) cam_from_world rotation of a level camera at `center` that looks at `target`."""
    forward = (target - center) / np.linalg.norm(target - center)
    level = np.cross(forward, [0.0, 0.0, 1.0])
    if np.linalg.norm(level) < 1e-6:
        level = np.array([1.0, 0.0, 0.0])
    right = level / np.linalg.norm(level)
    return np.array([right, np.cross(forward, right), forward])


def simulate_trajectory(scene: Scene) -> Trajectory:
    """The true poses of every frame: metric, Z up."""
    count = scene.video.frames
    times = np.arange(count) / scene.video.fps
    share = np.linspace(0, 1, count) if count > 1 else np.full(1, 0.5)
    path = scene.path
    if path.kind == "lawn_mower":
        centers, rotations = _lawn_mower_poses(path, share)
    else:
        centers = _look_at_centers(path, share)
        rotations = np.array([look_at(center, np.array(path.target)) for center in centers])
    rng = scene.random_stream(2)
    centers = centers + path.jitter_m * _hand_motion(rng, times)
    turns = Rotation.from_rotvec(np.radians(path.jitter_deg) * _hand_motion(rng, times)).as_matrix()
    rotations = turns @ rotations
    return Trajectory(
        camera=scene.camera.build(),
        indices=np.arange(count),
        times_s=times,
        rotations=rotations,
        translations=-np.einsum("nij,nj->ni", rotations, centers),
        metric=True,
        gravity=True,
    )


def _look_at_centers(path: PathBlock, share: FloatArray) -> FloatArray:
    """(N, 3) centres of the paths that look at a target."""
    sweep = path.arc_deg if path.kind in ("orbit", "handheld") else 0.0
    angle = np.radians(path.start_deg + sweep * share)
    radius = np.full(len(share), path.radius_m)
    if path.kind == "approach":
        radius += (path.end_radius_m - path.radius_m) * share
    x = path.target[0] + radius * np.cos(angle)
    y = path.target[1] + radius * np.sin(angle)
    return np.stack([x, y, np.full(len(share), path.height_m)], axis=1)


def _lawn_mower_poses(path: PathBlock, share: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Centres and rotations of parallel lanes along x, there and back, rounded at the ends."""
    place = share * path.lanes * (1 - 1e-9)
    lane = np.floor(place)
    along = -np.cos(np.pi * (place - lane)) / 2
    across = lane + np.clip((place - lane - 0.9) / 0.1, 0, 1) - path.lanes / 2
    across[lane == path.lanes - 1] = path.lanes / 2 - 1
    standoff = (path.height_m - path.target[2]) / np.tan(np.radians(path.pitch_deg))
    centers = np.stack(
        [
            path.target[0] + path.length_m * along * (-1) ** lane,
            path.target[1] - standoff + path.spacing_m * (across + 0.5),
            np.full(len(share), path.height_m),
        ],
        axis=1,
    )
    pitch = np.radians(path.pitch_deg)
    ahead = np.array([0.0, np.cos(pitch), -np.sin(pitch)])
    rotations = np.array([look_at(center, center + ahead) for center in centers])
    return centers, rotations


def _hand_motion(rng: np.random.Generator, times_s: FloatArray) -> FloatArray:
    """(N, 3) a smooth random motion of unit size, faster parts smaller."""
    motion = np.zeros((len(times_s), 3))
    for hertz in HAND_MOTION_HZ:
        rate = hertz * rng.uniform(0.8, 1.2, 3)
        phase = rng.uniform(0, 2 * np.pi, 3)
        motion += np.sin(2 * np.pi * rate * times_s[:, None] + phase) * (HAND_MOTION_HZ[0] / hertz)
    return motion
