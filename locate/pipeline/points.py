"""The sparse points of a reconstruction as a file."""

from pathlib import Path

import numpy as np

from geometry.arrays import FloatArray
from geometry.errors import BadInputError
from geometry.npz import check_numbers, read_npz, save_arrays


def load_points(path: Path) -> FloatArray | None:
    """(M, 3) sparse points of a reconstruction, or None where there is none.

    Raises:
        BadInputError: The file holds something else.
    """
    if not path.exists():
        return None
    try:
        points = read_npz(path)["points_in_world"]
        check_numbers(points_in_world=points)
    except (KeyError, ValueError) as error:
        raise BadInputError(f"{path}: not the points of a reconstruction ({error!r})") from error
    points = np.asarray(points, dtype=float)
    if points.ndim != 2 or points.shape[1] != 3 or not np.isfinite(points).all():
        raise BadInputError(f"{path}: {points.shape=}, expected (M, 3) finite numbers")
    return points


def save_points(path: Path, points_in_world: FloatArray) -> None:
    """Writes what `load_points` reads."""
    save_arrays(path, points_in_world=points_in_world)
