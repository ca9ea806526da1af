"""Rotations by quaternions from files."""

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

SHORTEST, LONGEST = 1e-6, 1e6
"""Largest number of a quaternion, that need not be of length 1; beyond, its length is not computed
exactly (chosen)."""


def rotation_of(quaternions: ArrayLike) -> Rotation:
    """The rotations of (4,) or (N, 4) quaternions x, y, z, w.

    Raises:
        ValueError: One is zero or far too long.
    """
    numbers = np.asarray(quaternions, dtype=float)
    size = np.abs(numbers).max(axis=-1, initial=0.0)
    if ((size < SHORTEST) | (size > LONGEST)).any():
        raise ValueError("rotation_xyzw: a quaternion is zero or far too long")
    return Rotation.from_quat(numbers)
