"""Scale, from a known distance or from the height of the cameras."""

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import least_squares

from geometry.arrays import FloatArray, IntArray
from geometry.errors import BadInputError
from geometry.georeference.constraints import ScaleConstraint
from geometry.georeference.ground import ground_plane
from geometry.trajectory import Trajectory

MAD_TO_SIGMA = 1.4826
"""Standard deviation over median absolute deviation, of a Gaussian."""
ROBUST_SIGMAS = 3.0
"""Residual, in sigmas, beyond which the soft L1 loss grows linearly; chosen."""
MAX_CONDITION = 1e8
"""Condition of the normal matrix beyond which rays count as parallel."""


def point_from_pixels(
    trajectory: Trajectory, rows: IntArray, pixels: FloatArray, *, sigma_px: float
) -> tuple[FloatArray, FloatArray]:
    """A point clicked in several frames.

    Args:
        trajectory: The cameras.
        rows: (K,) of the frames in the trajectory, K >= 2.
        pixels: (K, 2) where it is in each.
        sigma_px: Of a click along each axis.

    Returns:
        (3,) the point in the source frame, and its (3, 3) covariance; poses are taken for exact.

    Raises:
        BadInputError: Clicked in fewer than two frames, or from one place only.
    """
    if len(rows) < 2:
        raise BadInputError("a point must be clicked in at least two frames")
    rays = np.einsum("kji,kj->ki", trajectory.rotations[rows], trajectory.camera.rays(pixels))
    try:
        start = nearest_point(trajectory.centers_in_world[rows], rays)

        def residuals(point: FloatArray) -> FloatArray:
            seen = np.array([trajectory.project(int(row), point) for row in rows])
            return np.nan_to_num((seen - pixels) / sigma_px, nan=1e3).ravel()

        found = least_squares(
            residuals, start, x_scale="jac", loss="soft_l1", f_scale=ROBUST_SIGMAS
        )
        jacobian = np.asarray(found.jac)
        return found.x, np.linalg.inv(jacobian.T @ jacobian)
    except np.linalg.LinAlgError as error:
        raise BadInputError("a point must be clicked from two different places") from error


def nearest_point(centers: FloatArray, rays: FloatArray) -> FloatArray:
    """(3,) the point closest to (K, 3) rays from (K, 3) centres in the least-squares sense.

    Raises:
        LinAlgError: The rays are parallel.
    """
    across = np.eye(3) - rays[:, :, None] * rays[:, None, :]
    if np.linalg.cond(across.sum(axis=0)) > MAX_CONDITION:
        raise np.linalg.LinAlgError("the rays are parallel")
    right = np.einsum("kij,kj->i", across, centers)
    return np.asarray(np.linalg.solve(across.sum(axis=0), right))


def scale_from_distance(
    first: FloatArray,
    second: FloatArray,
    distance_m: float,
    *,
    sigma_m: float,
    covariances: tuple[FloatArray, FloatArray] | None = None,
    name: str = "known distance",
) -> ScaleConstraint:
    """Scale from the distance between two points of the source frame.

    Args:
        first: (3,) in the source frame.
        second: (3,) likewise.
        distance_m: Between them.
        sigma_m: Its standard deviation.
        covariances: (3, 3) of the two points.
        name: Of the source.

    Raises:
        BadInputError: The points coincide, or the distance is not positive.
    """
    apart = second - first
    length = float(np.linalg.norm(apart))
    if not (length > 0 and distance_m > 0 and sigma_m > 0):
        raise BadInputError(f"{name}: needs two different points, a distance > 0 m and its sigma")
    along = apart / length
    variance = (sigma_m / distance_m) ** 2
    if covariances is not None:
        variance += float(along @ (covariances[0] + covariances[1]) @ along) / length**2
    return ScaleConstraint(
        name=name, metres_per_unit=distance_m / length, sigma_log=float(np.sqrt(variance))
    )


def scale_from_height(
    trajectory: Trajectory,
    points_in_world: FloatArray,
    heights_m: ArrayLike,
    *,
    sigma_m: float,
    name: str = "height above ground",
) -> ScaleConstraint:
    """Scale from the height of the cameras above the ground plane.

    Args:
        trajectory: N cameras, in a world frame whose Z is roughly up.
        points_in_world: (M, 3) sparse points.
        heights_m: One for all, or (N,); NaN where not known.
        sigma_m: Of a height. Taken as one error that all frames share: the ground is not where
            the drone took off, and a camera in the hand has a height of its own.
        name: Of the source.

    Raises:
        BadInputError: No ground plane, or no positive height.
    """
    normal, offset = ground_plane(trajectory, points_in_world)
    own = trajectory.centers_in_world @ normal - offset
    heights = np.broadcast_to(np.asarray(heights_m, dtype=float), own.shape)
    known = np.isfinite(heights) & (heights > 0) & (own > 0)
    if not known.any() or not sigma_m > 0:
        raise BadInputError(f"{name}: no camera with a known height > 0 m above the ground")
    ratios = np.log(heights[known] / own[known])
    spread = MAD_TO_SIGMA * float(np.median(np.abs(ratios - np.median(ratios))))
    shared = sigma_m / float(np.median(heights[known]))
    return ScaleConstraint(
        name=name,
        metres_per_unit=float(np.exp(np.median(ratios))),
        sigma_log=float(np.hypot(shared, spread)),
    )
