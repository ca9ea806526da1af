"""Fixes of the cameras, as constraints."""

import numpy as np
from numpy.typing import ArrayLike

from geometry.arrays import FloatArray, IntArray
from geometry.georeference.constraints import PositionConstraint
from geometry.trajectory import Trajectory

MAX_FIXES = 200
"""Most fixes of one source in the fit, whose cost grows with their number cubed."""


def positions_of_cameras(
    trajectory: Trajectory,
    positions_in_enu: FloatArray,
    sigmas_m: ArrayLike,
    *,
    name: str = "GPS",
    shared_sigma_m: tuple[float, float, float] = (0.0, 0.0, 0.0),
) -> PositionConstraint:
    """Fixes of the cameras.

    A fix that repeats the one before while the camera moved on is a stale one and is left out.
    Above `MAX_FIXES` they are thinned evenly: neighbours share their error.

    Args:
        trajectory: N cameras.
        positions_in_enu: (N, 3) where each was, m; NaN rows where there is no fix.
        sigmas_m: (3,) or (N, 3) standard deviations along east, north, up.
        name: Of the source.
        shared_sigma_m: Of an error common to all fixes.
    """
    known = np.isfinite(positions_in_enu).all(axis=1)
    rows = np.flatnonzero(known)
    repeated = np.zeros(len(rows), dtype=bool)
    repeated[1:] = (np.diff(positions_in_enu[rows], axis=0) == 0).all(axis=1)
    rows = rows[~repeated]
    if len(rows) > MAX_FIXES:
        rows = rows[np.linspace(0, len(rows) - 1, MAX_FIXES).round().astype(int)]
    sigmas = np.broadcast_to(np.asarray(sigmas_m, dtype=float), positions_in_enu.shape)
    return PositionConstraint(
        name=name,
        points_in_source=trajectory.centers_in_world[rows],
        positions_in_target=positions_in_enu[rows],
        sigmas_m=sigmas[rows],
        covariances_in_source=_center_covariances(trajectory, rows),
        times_s=trajectory.times_s[rows],
        shared_sigma_m=shared_sigma_m,
    )


def _center_covariances(trajectory: Trajectory, rows: IntArray) -> FloatArray | None:
    """(N, 3, 3) of the centres in the world; zero where unknown."""
    if trajectory.covariances is None:
        return None
    world_from_cam = trajectory.rotations[rows].swapaxes(1, 2)
    own = np.nan_to_num(trajectory.covariances[rows][:, 3:, 3:])
    return np.asarray(world_from_cam @ own @ world_from_cam.swapaxes(1, 2))
