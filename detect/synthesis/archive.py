"""Arrays in a file: written whole or not at all, and never unpickled."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from geometry.atomic import replacing
from geometry.errors import BadInputError
from geometry.npz import BROKEN


def save_arrays(path: Path, **arrays: np.ndarray) -> None:
    """Writes a compressed .npz under a temporary name, then renames it.

    Raises:
        BadInputError: The file cannot be written.
    """
    try:
        with replacing(path) as unfinished, unfinished.open("wb") as file:
            np.savez_compressed(file, allow_pickle=False, **arrays)
    except OSError as error:
        raise BadInputError(f"{path}: cannot be written ({error})") from error


@contextmanager
def open_arrays(path: Path, what: str) -> Iterator[Any]:
    """The arrays of an .npz by name, each read when it is asked for.

    Raises:
        BadInputError: The file is missing or broken, or lacks an array; `what` says what it is not.
    """
    try:
        with path.open("rb") as stream, np.load(stream, allow_pickle=False) as file:
            yield file
    except (*BROKEN, KeyError) as error:
        raise BadInputError(f"{path}: not {what}, delete it ({error})") from error
