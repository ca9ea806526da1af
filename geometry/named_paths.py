"""Paths that were read from a file, whose writer may have named anything."""

from pathlib import Path


def is_there(path: Path) -> bool:
    """Whether a file or folder is there; none is by a name that no file system takes."""
    try:
        path.stat()
    except (OSError, ValueError):
        return False
    return True
