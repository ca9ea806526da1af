"""The plane that most sparse points lie on."""

import numpy as np

from geometry.arrays import FloatArray
from geometry.errors import BadInputError
from geometry.sfm.gauge import dominant_plane
from geometry.trajectory import Trajectory

MIN_PLANE_SHARE = 0.1
"""Least share of the points that lie on the ground plane."""
PLANE_TOLERANCE = 0.02
"""Distance from the plane at which a point lies on it, over the distance to the points."""
OFFSET_CANDIDATES = 1000
"""About how many heights of points are tried as that of the plane."""


def ground_plane(trajectory: Trajectory, points_in_world: FloatArray) -> tuple[FloatArray, float]:
    """Normal and offset of the dominant plane, ``normal @ x = offset``, its normal near +Z.

    Raises:
        BadInputError: No plane holds a tenth of the points.
    """
    finite = points_in_world[np.isfinite(points_in_world).all(axis=1)]
    if len(finite) == 0:
        raise BadInputError("ground plane: there are no sparse points")
    centers = trajectory.centers_in_world
    tolerance = PLANE_TOLERANCE * float(
        np.median(np.linalg.norm(finite - np.median(centers, axis=0), axis=1))
    )
    normal, share = dominant_plane(finite, tolerance, near=np.array([0.0, 0.0, 1.0]))
    if share < MIN_PLANE_SHARE:
        raise BadInputError(
            f"ground plane: the best plane holds {100 * share:.0f} % of the points (needs 10 %)"
        )
    heights = finite @ normal
    candidates = heights[:: max(1, len(heights) // OFFSET_CANDIDATES)]
    counts = (np.abs(heights[:, None] - candidates) < tolerance).sum(axis=0)
    offset = candidates[np.argmax(counts)]
    return normal, float(np.median(heights[np.abs(heights - offset) < tolerance]))
