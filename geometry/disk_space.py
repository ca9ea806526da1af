"""Room on a disk, asked for before a library that would end the process without it."""

import os
from pathlib import Path

from geometry.atomic import UNSUPPORTED, unfinished_name


def check_space(folder: Path, size: int) -> None:
    """Sets room aside in a folder and gives it back: quotas count, not the disk alone.

    Args:
        folder: It exists.
        size: Bytes that will be written there.

    Raises:
        OSError: There is less; the error names the folder and the room that is needed.
    """
    path = folder / unfinished_name("room")
    try:
        descriptor = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, 0o666)
        try:
            os.posix_fallocate(descriptor, 0, size)
        finally:
            os.close(descriptor)
    except OSError as error:
        if error.errno not in UNSUPPORTED:
            needed = f"{error.strerror}; {-(-size // 2**20)} MiB are needed"
            raise OSError(error.errno, needed, str(folder)) from error
    finally:
        path.unlink(missing_ok=True)
