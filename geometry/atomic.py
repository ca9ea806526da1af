"""Files that are written whole or not at all."""

import errno
import os
import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from uuid import uuid4

UNFINISHED = re.compile(r"\..*\.partial(\.[^.]*)?")
"""Names of files that `atomic_path` has not renamed yet."""
UNSUPPORTED = (errno.EINVAL, errno.ENOSYS, errno.EOPNOTSUPP)
"""What the kernel says where a file system cannot sync, or set room aside."""


@contextmanager
def atomic_path(path: Path) -> Iterator[Path]:
    """A name beside `path`, of the same suffix, to write to; renamed to `path` at the end.

    The content is on the disk before the name is. Where the block raises, what stood at `path` is
    untouched and nothing else is left. Several processes may write the same file: each has a name
    of its own, and the last one is kept.
    """
    unfinished = path.with_name(unfinished_name(path.name))
    try:
        yield unfinished
        sync(unfinished)
        unfinished.replace(path)
        sync(path.parent)
    finally:
        unfinished.unlink(missing_ok=True)


def unfinished_name(name: str) -> str:
    """A name for a file that is not to outlive its writer; no other process has the same."""
    path = Path(name)
    return f".{path.stem}.{os.getpid()}-{uuid4().hex[:8]}.partial{path.suffix}"


def sync(path: Path) -> None:
    """Waits until a file, or the names in a folder, would outlive a loss of power.

    Raises:
        OSError: The disk failed.
    """
    descriptor = os.open(path, os.O_RDONLY | os.O_CLOEXEC)
    try:
        os.fsync(descriptor)
    except OSError as error:
        if error.errno not in UNSUPPORTED:
            raise OSError(error.errno, error.strerror, str(path)) from error
    finally:
        os.close(descriptor)


def sync_tree(folder: Path) -> None:
    """Likewise of all that lies in a folder, at any depth.

    Raises:
        OSError: The disk failed.
    """
    for path in [*folder.rglob("*"), folder]:
        if path.is_file() or path.is_dir():
            sync(path)


def write_text_atomic(path: Path, text: str) -> None:
    """Writes a text file whole or not at all."""
    with atomic_path(path) as unfinished:
        unfinished.write_text(text)


def is_unfinished(path: Path) -> bool:
    """Whether a file bears a name that `atomic_path` gives."""
    return UNFINISHED.fullmatch(path.name) is not None


def remove_unfinished(folder: Path) -> None:
    """Removes what killed processes left at any depth; none may be writing there now."""
    for path in list(folder.rglob(".*")):
        if is_unfinished(path) and path.is_file() and not path.is_symlink():
            path.unlink(missing_ok=True)
