"""Files that are written whole or not at all."""

import os
import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from uuid import uuid4

UNFINISHED = re.compile(r"\..*\.partial(\.[^.]*)?")
"""Names of files that `atomic_path` has not renamed yet."""


@contextmanager
def atomic_path(path: Path) -> Iterator[Path]:
    """A name beside `path`, of the same suffix, to write to; renamed to `path` at the end.

    Where the block raises, what stood at `path` is untouched and nothing else is left. Several
    processes may write the same file: each has a name of its own, and the last one is kept.
    """
    unique = f"{os.getpid()}-{uuid4().hex[:8]}"
    unfinished = path.with_name(f".{path.stem}.{unique}.partial{path.suffix}")
    try:
        yield unfinished
        unfinished.replace(path)
    finally:
        unfinished.unlink(missing_ok=True)


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
