"""The paths that a command is given, before it reads any of them."""

from collections.abc import Iterable
from pathlib import Path

from geometry.errors import BadInputError
from geometry.image_files import is_stream


def refuse_pipes(given: Iterable[object]) -> None:
    """Refuses what never ends, or ends when somebody else writes: pipes, sockets, devices.

    Args:
        given: The values of a command's options and arguments.

    Raises:
        BadInputError: A path among them is neither a file nor a folder.
    """
    for value in given:
        for path in value if isinstance(value, list | tuple) else [value]:
            if isinstance(path, str | Path) and is_stream(Path(path)):
                raise BadInputError(f"{path}: a pipe or a device; give a file or a folder")
