"""Scale, from a known distance or from the height of the cameras."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import least_squares

from geometry.arrays import FloatArray, IntArray
from geometry.errors import BadInputError
from geometry.georeference.constraints import ScaleConstraint
from geometry.georeference.ground import ground_plane
from geometry.normal_errors import MAD_TO_SIGMA
from geometry.trajectory import Trajectory

ROBUST_SIGMAS = 3.0
"""Residual, in sigmas, beyond which the soft L1 loss grows linearly; chosen."""
MAX_MISFIT = 4.0
"""Root of the chi-squared of a point's clicks per degree of freedom beyond which they are on no
common point; chosen."""
MAX_CLICK_SIGMAS = 6.0
"""Residual of one click, in sigmas, beyond which it is on another point than the rest; chosen."""
MAX_CONDITION = 1e8
"""Condition of the normal matrix beyond which rays count as parallel."""


def point_from_pixels(
    trajectory: Trajectory,
    rows: IntArray,
    pixels: FloatArray,
    *,
    sigma_px: float,
    names: Sequence[str] | None = None,
) -> tuple[FloatArray, FloatArray]:
    """A point clicked in several frames.

    Args:
        trajectory: The cameras.
        rows: (K,) of the frames in the trajectory, K >= 2.
        pixels: (K, 2) where it is in each.
        sigma_px: Of a click along each axis.
        names: K names of the frames, for messages; else their rows.

    Returns:
        (3,) the point in the source frame, and its (3, 3) covariance; poses are taken for exact,
        clicks for as much worse than stated as they fit each other worse.

    Raises:
        BadInputError: Clicked in fewer than two frames, from one place only, or the clicks are on
            no common point.
    """
    if len(rows) < 2:
        raise BadInputError("a point must be clicked in at least two frames")
    rays = np.einsum("kji,kj->ki", trajectory.rotations[rows], trajectory.camera.rays(pixels))

    def offsets_px(point: FloatArray) -> FloatArray:
        seen = np.array([trajectory.project(int(row), point) for row in rows])
        return np.asarray(seen - pixels)

    def residuals(point: FloatArray) -> FloatArray:
        return np.nan_to_num(offsets_px(point) / sigma_px, nan=1e3).ravel()

    names = names or [f"frame {int(row)}" for row in rows]
    try:
        start = nearest_point(trajectory.centers_in_world[rows], rays)
        _check_in_front(offsets_px(start), names)
        found = least_squares(
            residuals, start, x_scale="jac", loss="soft_l1", f_scale=ROBUST_SIGMAS
        )
        jacobian = np.asarray(found.jac)
        covariance = np.linalg.inv(jacobian.T @ jacobian)
    except np.linalg.LinAlgError as error:
        raise BadInputError("a point must be clicked from two different places") from error
    misfit = _check_clicks(offsets_px(found.x), sigma_px, names)
    return found.x, covariance * max(1.0, misfit) ** 2


def _check_clicks(offsets_px: FloatArray, sigma_px: float, names: Sequence[str]) -> float:
    """Root of chi-squared per degree of freedom of (K, 2) offsets of clicks from their point.

    Raises:
        BadInputError: They are on no common point.
    """
    _check_in_front(offsets_px, names)
    off = np.linalg.norm(offsets_px, axis=1)
    misfit = float(np.sqrt((off**2).sum() / (2 * len(off) - 3))) / sigma_px
    if misfit > MAX_MISFIT or off.max() > MAX_CLICK_SIGMAS * sigma_px:
        listed = ", ".join(f"{name} {px:.1f} px" for name, px in zip(names, off, strict=True))
        raise BadInputError(
            f"the clicks are on no common point: residuals {listed}, sigma_px is {sigma_px:g}; "
            "click the same spot in each frame, or state a larger sigma_px"
        )
    return misfit


def _check_in_front(offsets_px: FloatArray, names: Sequence[str]) -> None:
    behind = np.flatnonzero(np.isnan(offsets_px).any(axis=1))
    if len(behind):
        raise BadInputError(
            f"the clicks are on no common point: their lines of sight meet behind the camera of "
            f"{names[int(behind[0])]}"
        )


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
