"""One process at a time at work on a folder."""

import errno
import fcntl
import logging
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from geometry.errors import BadInputError

LOCK = ".lock"
"""An empty file in the folder, never removed: who removes a lock may remove another's."""
UNSUPPORTED = (errno.ENOLCK, errno.EOPNOTSUPP, errno.ENOSYS, errno.EINVAL)
"""What the kernel says where a file system, such as some network shares, has no locks."""
log = logging.getLogger("locate")


@contextmanager
def hold_lock(
    folder: Path, name: str = LOCK, *, shared: bool = False, wait: bool = False
) -> Iterator[None]:
    """Holds a folder while the block runs; the kernel lets go of it when the process ends.

    Args:
        folder: It exists.
        name: Of the lock, where the folder has several.
        shared: Others that share it may hold it at the same time.
        wait: Until it is free, instead of raising.

    Raises:
        BadInputError: Another process holds it.
        OSError: The lock cannot be written.
    """
    flags = os.O_RDWR | os.O_CREAT | os.O_CLOEXEC | os.O_NOFOLLOW
    descriptor = os.open(folder / name, flags, 0o666)
    how = fcntl.LOCK_SH if shared else fcntl.LOCK_EX
    try:
        try:
            fcntl.flock(descriptor, how if wait else how | fcntl.LOCK_NB)
        except BlockingIOError as error:
            raise BadInputError(
                f"{folder}: another command is at work on this folder; wait until it has ended, "
                "or choose another folder with -o"
            ) from error
        except OSError as error:
            if error.errno not in UNSUPPORTED:
                raise
            log.warning("%s: its file system has no locks; give it to one command only", folder)
        yield
    finally:
        os.close(descriptor)


@contextmanager
def hold_output(folder: Path) -> Iterator[None]:
    """Makes the folder that a command writes to, and holds it while the block runs.

    Raises:
        BadInputError: It cannot be made, or another command is at work on it.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise BadInputError(
            f"{folder}: cannot be written ({error.strerror}); choose another folder with -o"
        ) from error
    with hold_lock(folder):
        yield
