"""Single poses of a path that lie far off it: jumps of a tracker, lines of a file in disorder."""

import numpy as np

from geometry.arrays import IntArray
from geometry.trajectory import Trajectory

STRAY = 3.0
"""A pose is off the path where it is so many times farther from either neighbour than these are
from each other, and than a usual step; chosen by hand."""


def stray_rows(trajectory: Trajectory) -> IntArray:
    """Rows of the poses, in the order of their frames, that lie far off the path.

    The first and the last are never among them, nor neighbours that jump together.
    """
    centers = trajectory.centers_in_world
    if len(centers) < 3:
        return np.zeros(0, dtype=np.int64)
    steps = np.linalg.norm(np.diff(centers, axis=0), axis=1)
    apart = np.linalg.norm(centers[2:] - centers[:-2], axis=1)
    off_path = np.minimum(steps[1:], steps[:-1]) > STRAY * np.maximum(apart, np.median(steps))
    return np.flatnonzero(off_path).astype(np.int64) + 1
