"""Arrays in .npz files: written whole or not at all, never unpickled, and maybe broken."""

import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any
from zipfile import BadZipFile

import numpy as np
from numpy.typing import ArrayLike

from geometry.atomic import atomic_path
from geometry.errors import BadInputError

BROKEN = (OSError, EOFError, TypeError, ValueError, BadZipFile, zlib.error)
"""What numpy raises for an .npz file that cannot be read."""


def save_arrays(path: Path, **arrays: ArrayLike) -> None:
    """Writes a compressed .npz under a temporary name, then renames it.

    Raises:
        BadInputError: The file cannot be written.
    """
    try:
        with atomic_path(path) as unfinished, unfinished.open("wb") as file:
            np.savez_compressed(file, allow_pickle=False, **arrays)
    except OSError as error:
        raise BadInputError(f"{path}: cannot be written ({error})") from error


@contextmanager
def open_arrays(path: Path, what: str) -> Iterator[Any]:
    """The arrays of a .npz file by name, each read when it is asked for.

    Raises:
        BadInputError: The file is missing, broken or lacks an array. `what` is its name for people.
    """
    try:
        with path.open("rb") as stream, np.load(stream, allow_pickle=False) as file:
            yield file
    except (*BROKEN, KeyError) as error:
        raise BadInputError(f"{path}: not {what}, delete it ({error})") from error


def read_npz(path: Path) -> dict[str, np.ndarray[Any, Any]]:
    """All arrays of a .npz file, by name.

    Raises:
        BadInputError: The file is missing, cut short, or not a .npz of plain arrays.
    """
    try:
        with path.open("rb") as stream, np.load(stream, allow_pickle=False) as file:
            return {name: file[name] for name in file.files}
    except BROKEN as error:
        raise BadInputError(f"{path}: missing or not a readable .npz file") from error
