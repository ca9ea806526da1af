"""The sparse points of a reconstruction as a file."""

from pathlib import Path

import numpy as np

from geometry.arrays import FloatArray
from geometry.npz import read_npz, save_arrays


def load_points(path: Path) -> FloatArray | None:
    """(M, 3) sparse points of a reconstruction, or None where there is none."""
    if not path.exists():
        return None
    return np.asarray(read_npz(path)["points_in_world"], dtype=float)


def save_points(path: Path, points_in_world: FloatArray) -> None:
    """Writes what `load_points` reads."""
    save_arrays(path, points_in_world=points_in_world)
