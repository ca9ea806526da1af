"""Arrays from .npz files that may be broken."""

import zlib
from pathlib import Path
from typing import Any
from zipfile import BadZipFile

import numpy as np

from geometry.errors import BadInputError

BROKEN = (OSError, EOFError, TypeError, ValueError, BadZipFile, zlib.error)


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
