"""Files and folders removed by name, never outside the folder that holds them."""

import shutil
from pathlib import Path

from geometry.errors import BadInputError
from geometry.named_paths import resolve_path

LONGEST_NAME = 255
"""Bytes, of Linux's file systems."""


def is_plain_name(name: object) -> bool:
    """Whether a name that was read from a file is that of one entry directly in a folder."""
    if not isinstance(name, str) or name in ("", ".", "..") or {"/", "\0"} & set(name):
        return False
    return len(name.encode(errors="surrogatepass")) <= LONGEST_NAME


def path_inside(folder: Path, name: str) -> Path:
    """The path of that name in the folder.

    Raises:
        BadInputError: The name, or a link behind it, leads outside the folder.
    """
    path = folder / name
    if resolve_path(folder) not in resolve_path(path).parents:
        raise BadInputError(
            f"{path}: leads outside {folder}; remove this link or choose another folder"
        )
    return path


def remove_inside(folder: Path, name: str) -> None:
    """Removes a file or a folder in `folder`, if it is there.

    Raises:
        BadInputError: It lies outside the folder, or a link leads there; nothing is removed.
    """
    path = path_inside(folder, name)
    if path.is_symlink() or not path.is_dir():
        path.unlink(missing_ok=True)
    else:
        shutil.rmtree(path)
