"""Up, from the attitude of the camera, from accelerometers, or from the ground."""

import numpy as np

from geometry.arrays import FloatArray
from geometry.errors import BadInputError
from geometry.georeference.constraints import UpConstraint
from geometry.georeference.ground import ground_plane
from geometry.normal_errors import MAD_TO_SIGMA
from geometry.trajectory import Trajectory


def up_from_gimbal(
    trajectory: Trajectory,
    pitch_deg: FloatArray,
    roll_deg: FloatArray,
    *,
    shared_sigma_deg: float = 0.5,
    name: str = "gimbal",
) -> UpConstraint:
    """Up from the attitude of the camera.

    Args:
        trajectory: N cameras.
        pitch_deg: (N,) of the optical axis above the horizon: -90 looks straight down.
        roll_deg: (N,) to the right, about the optical axis.
        shared_sigma_deg: Of what all frames share: how the camera sits in its gimbal.
        name: Of the source.
    """
    pitch, roll = np.radians(pitch_deg), np.radians(roll_deg)
    ups_in_cam = np.stack(
        [-np.cos(pitch) * np.sin(roll), -np.cos(pitch) * np.cos(roll), np.sin(pitch)], axis=1
    )
    return up_from_vectors(trajectory, ups_in_cam, shared_sigma_deg=shared_sigma_deg, name=name)


def up_from_vectors(
    trajectory: Trajectory,
    ups_in_cam: FloatArray,
    *,
    shared_sigma_deg: float = 0.5,
    name: str = "accelerometer",
) -> UpConstraint:
    """Up as each frame has it, as an accelerometer at rest does.

    The answer is the mean of those within three robust sigmas of the median. Its sigma takes
    neighbouring frames for as alike as their errors show.

    Args:
        trajectory: N cameras.
        ups_in_cam: (N, 3) up in the camera frame (x right, y down, z forward), of any length; NaN
            where it is not known.
        shared_sigma_deg: Of what all frames share.
        name: Of the source.

    Raises:
        BadInputError: No frame knows, or they do not agree on a hemisphere.
    """
    known = np.isfinite(ups_in_cam).all(axis=1) & (np.linalg.norm(ups_in_cam, axis=1) > 0)
    if not known.any():
        raise BadInputError(f"{name}: no frame has a direction of up")
    ups = np.einsum("nji,nj->ni", trajectory.rotations[known], ups_in_cam[known])
    ups /= np.linalg.norm(ups, axis=1, keepdims=True)
    middle = np.median(ups, axis=0)
    if np.linalg.norm(middle) < 0.5:
        raise BadInputError(f"{name}: the frames disagree about up by more than 60 deg")
    middle /= np.linalg.norm(middle)
    off = np.linalg.norm(ups - middle, axis=1)
    sigma = MAD_TO_SIGMA / np.sqrt(2) * float(np.median(off))
    kept = ups[off <= max(3 * np.sqrt(2) * sigma, 1e-9)]
    mean = kept.mean(axis=0) / np.linalg.norm(kept.mean(axis=0))
    spread = float(np.sqrt(((kept - mean) ** 2).sum() / 2 / max(len(kept) - 1, 1)))
    own = spread / np.sqrt(_effective_count(kept - mean))
    return UpConstraint(
        name=name,
        up_in_source=mean,
        sigma_rad=float(np.hypot(own, np.radians(shared_sigma_deg))),
    )


def up_from_ground(
    trajectory: Trajectory,
    points_in_world: FloatArray,
    *,
    slope_sigma_deg: float = 3.0,
    name: str = "ground plane",
) -> UpConstraint:
    """Up as the normal of the plane that most sparse points lie on.

    Args:
        trajectory: The cameras, in a world frame whose Z is roughly up.
        points_in_world: (M, 3) sparse points.
        slope_sigma_deg: How level the ground is, about each axis. The fit itself is good to 0.4
            deg; the slope of the ground limits it: state what is known of that.
        name: Of the source.

    Raises:
        BadInputError: No plane holds a tenth of the points.
    """
    normal, _ = ground_plane(trajectory, points_in_world)
    return UpConstraint(
        name=name, up_in_source=normal, sigma_rad=float(np.radians(slope_sigma_deg))
    )


def _effective_count(errors: FloatArray) -> float:
    """Number of independent samples in (N, D) errors, from the correlation of neighbours."""
    n = len(errors)
    total = float((errors**2).sum())
    if n < 3 or total == 0:
        return float(n)
    next_to = float(np.clip((errors[1:] * errors[:-1]).sum() / total, 0.0, 0.99))
    return max(1.0, n * (1 - next_to) / (1 + next_to))
