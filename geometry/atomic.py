"""Files that are written whole or not at all."""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path


@contextmanager
def atomic_path(path: Path) -> Iterator[Path]:
    """A name beside `path`, of the same suffix, to write to; renamed to `path` at the end.

    Where the block raises, what stood at `path` is untouched and nothing else is left. Several
    processes may write the same file: each has a name of its own, and the last one is kept.
    """
    unfinished = path.with_name(f".{path.stem}.{os.getpid()}.partial{path.suffix}")
    try:
        yield unfinished
        unfinished.replace(path)
    finally:
        unfinished.unlink(missing_ok=True)


def write_text_atomic(path: Path, text: str) -> None:
    """Writes a text file whole or not at all."""
    with atomic_path(path) as unfinished:
        unfinished.write_text(text)
