"""Arrays in .npz files, which are written whole or not at all, and read without unpickling."""

import math
import struct
import zlib
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from lzma import LZMAError
from pathlib import Path
from typing import IO, Any, BinaryIO
from zipfile import BadZipFile, ZipFile, ZipInfo

import numpy as np
from numpy.lib import format as npy
from numpy.typing import ArrayLike

from geometry.arrays import FloatMap
from geometry.atomic import atomic_path
from geometry.errors import BadInputError, UnwritableError, short_reason
from geometry.regular_files import open_regular

BROKEN = (
    OSError, EOFError, TypeError, ValueError, RuntimeError, MemoryError, OverflowError,
    SyntaxError, BadZipFile, LZMAError, struct.error, zlib.error,
)  # fmt: skip
"""What numpy raises for an .npz file that cannot be read."""
MOST_BYTES = 2**30
"""Of all arrays of a file that is read at once, or of one array; ours stay well below."""
KINDS = "biufU"
"""Of numpy's types, those that are read: truth values, real numbers and texts."""
DEFLATE_RATIO = 1032
"""No compressed byte stands for more."""


def save_arrays(
    path: Path, write: Callable[..., None] = np.savez_compressed, /, **arrays: ArrayLike
) -> None:
    """Writes a .npz under a temporary name, then renames it.

    Args:
        path: The file.
        write: numpy's way: noise gets little smaller by compression, and takes long.
        arrays: By name.

    Raises:
        UnwritableError: The file cannot be written.
    """
    try:
        with atomic_path(path) as unfinished, unfinished.open("wb") as file:
            write(file, allow_pickle=False, **arrays)
    except OSError as error:
        raise UnwritableError.of(path, error) from error


def as_float32(array: np.ndarray[Any, Any]) -> FloatMap:
    """An array of a file in single precision.

    Raises:
        ValueError: A number is too large for it, or it holds texts or truth values.
    """
    check_numbers(array=array)
    try:
        with np.errstate(over="raise"):
            return array.astype(np.float32)
    except FloatingPointError as error:
        raise ValueError("a number is too large") from error


def check_numbers(**arrays: np.ndarray[Any, Any]) -> None:
    """Refuses arrays of texts and of truth values, by their names.

    Raises:
        ValueError: One holds no numbers.
    """
    others = [name for name, array in arrays.items() if array.dtype.kind in "bU"]
    if others:
        raise ValueError(f"{others[0]} holds no numbers")


@contextmanager
def open_arrays(path: Path, what: str) -> Iterator[Any]:
    """The arrays of a .npz file by name, each read when it is asked for.

    Raises:
        BadInputError: The file is missing, broken or lacks an array. `what` is its name for people.
    """
    try:
        with open_regular(path) as stream:
            _check_sizes(stream)
            with np.load(stream, allow_pickle=False) as file:
                yield file
    except (*BROKEN, LookupError) as error:
        raise BadInputError(f"{path}: not {what}, delete it ({error})") from error


def read_npz(path: Path) -> dict[str, np.ndarray[Any, Any]]:
    """All arrays of a .npz file, by name.

    Raises:
        BadInputError: The file is missing, cut short, or not a .npz of plain arrays.
    """
    try:
        with open_regular(path) as stream:
            if _check_sizes(stream) > MOST_BYTES:
                raise ValueError(f"its arrays take more than {MOST_BYTES // 2**20} MiB")
            with np.load(stream, allow_pickle=False) as file:
                return {name: file[name] for name in file.files}
    except BROKEN as error:
        reason = short_reason(error)
        raise BadInputError(f"{path}: missing or not a readable .npz file ({reason})") from error


def _check_sizes(stream: BinaryIO) -> int:
    """Compares what a file declares with what it holds, before memory is taken.

    Returns:
        The bytes of all arrays.

    Raises:
        ValueError: An array is larger than its file, or declares another size than it has.
    """
    total = 0
    with ZipFile(stream) as archive:
        for entry in archive.infolist():
            _check_entry(archive, entry)
            total += entry.file_size
    stream.seek(0)
    return total


def _check_entry(archive: ZipFile, entry: ZipInfo) -> None:
    name = entry.filename
    if not name.endswith(".npy"):
        raise ValueError(f"{name} is no array")
    if entry.file_size > DEFLATE_RATIO * entry.compress_size + DEFLATE_RATIO:
        raise ValueError(f"{name} declares more than the file holds")
    if entry.file_size > MOST_BYTES:
        raise ValueError(f"{name} takes more than {MOST_BYTES // 2**20} MiB")
    with archive.open(entry) as member:
        declared = _array_bytes(member)
        if member.tell() + declared != entry.file_size:
            raise ValueError(f"{name} has another size than it declares")


def _array_bytes(member: IO[bytes]) -> int:
    """Of the array whose header comes next, by its shape and type."""
    version = npy.read_magic(member)
    read = npy.read_array_header_1_0 if version == (1, 0) else npy.read_array_header_2_0
    shape, _, dtype = read(member)
    if dtype.kind not in KINDS:
        raise ValueError(f"arrays of {dtype} are not read")
    return math.prod(shape) * dtype.itemsize
