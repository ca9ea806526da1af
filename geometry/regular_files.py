"""Regular files: pipes, sockets and devices are refused, as reading them may never end."""

import errno
import os
import stat
from io import BufferedReader, TextIOWrapper
from pathlib import Path

from geometry.errors import BadInputError

STREAM = "a pipe or a device; store it as a file and give that"
MOST_BYTES = 2**30
"""Largest file that is read at once; the largest photos have some hundred MiB."""


def is_stream(path: Path) -> bool:
    """Whether a path is a pipe, a socket or a device."""
    try:
        return path.exists() and not path.is_file() and not path.is_dir()
    except OSError:
        return False  # reading it raises the same error


def refuse_streams(path: Path) -> None:
    """Refuses a path that another library would open and wait for.

    Raises:
        BadInputError: It is a pipe, a socket or a device.
    """
    if is_stream(path):
        raise BadInputError(f"{path}: {STREAM}")


def refuse_streams_within(path: Path) -> None:
    """Refuses a file that another library would wait for, or a folder with one directly in it.

    Raises:
        BadInputError: One is a pipe, a socket or a device, or the folder cannot be read.
    """
    try:
        files = sorted(path.iterdir()) if path.is_dir() else [path]
    except OSError as error:
        raise BadInputError(f"{path}: cannot be read ({error.strerror})") from error
    for file in files:
        refuse_streams(file)


def open_regular(path: Path) -> BufferedReader:
    """Opens a file for reading, without waiting for the writer of a pipe.

    Raises:
        OSError: It cannot be opened, or is a pipe or a device.
    """
    return open(path, "rb", opener=_open_regular)


def read_start(path: Path, most: int) -> bytes:
    """The first bytes of a file, at most `most`.

    Raises:
        BadInputError: It cannot be read, or is a pipe or a device.
    """
    try:
        with open_regular(path) as file:
            return file.read(most)
    except OSError as error:
        raise BadInputError(f"{path}: cannot be read ({error.strerror})") from error


def append_regular(path: Path) -> TextIOWrapper:
    """Opens a text file for appending, without waiting for the reader of a pipe.

    Raises:
        OSError: It cannot be opened, or is a pipe or a device.
    """
    return open(path, "a", opener=_open_regular)


def read_content(path: Path) -> bytes:
    """All bytes of a file.

    Raises:
        OSError: It cannot be read, is a pipe or a device, or too large to be held in memory.
    """
    with open_regular(path) as file:
        content = file.read(MOST_BYTES + 1)
    if len(content) > MOST_BYTES:
        raise OSError(errno.EFBIG, f"over {MOST_BYTES // 2**20} MiB", str(path))
    return content


def _open_regular(path: str, flags: int) -> int:
    descriptor = os.open(path, flags | os.O_NONBLOCK, 0o666)
    kind = os.fstat(descriptor).st_mode
    if stat.S_ISREG(kind) or stat.S_ISDIR(kind):  # `open` itself refuses a folder
        return descriptor
    os.close(descriptor)
    raise OSError(errno.EINVAL, STREAM, path)
