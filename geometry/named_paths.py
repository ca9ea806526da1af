"""Paths as users give them, which may be invalid or lead in circles."""

from pathlib import Path

from geometry.errors import BadInputError


def is_there(path: Path) -> bool:
    """Whether a file or folder exists; False too for a name that no file system takes."""
    try:
        path.stat()
    except (OSError, ValueError):
        return False
    return True


def resolve_path(path: Path) -> Path:
    """The absolute path that all symbolic links lead to.

    Raises:
        BadInputError: They lead in a circle.
    """
    try:
        return path.resolve()
    except RuntimeError as error:
        raise BadInputError(f"{path}: its links lead in a circle; remove them") from error
