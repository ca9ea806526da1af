"""What a finished run can do without."""

from dataclasses import dataclass
from pathlib import Path

from geometry.errors import BadInputError
from locate.pipeline.files import RunFiles
from locate.pipeline.run_folder import RunFolder

DISPENSABLE = {
    "frames": "frames; further stages, clicks of known distances and `locate view` need them",
    "poses": "reconstruction in a frame of its own",
    "detections": "measurements; `locate survey`, `evaluate` and `view` need them",
}
"""Stages whose results neither the map nor the report needs, and what these are."""


@dataclass(frozen=True, kw_only=True)
class Dispensable:
    """Something that the next run makes again where it needs it.

    Attributes:
        name: Its path below the run folder.
        size: Bytes, of all its files.
        what: It is.
    """

    name: str
    size: int
    what: str


def open_finished(output: Path) -> RunFolder:
    """A run folder that holds a map.

    Raises:
        BadInputError: It is none.
    """
    if not RunFiles(output).map.is_file():
        raise BadInputError(f"{output}: not the folder of a finished run (it holds no map.json)")
    return RunFolder(output)


def list_dispensable(folder: RunFolder) -> list[Dispensable]:
    """What `remove_dispensable` removes."""
    found = [(path, what) for name, what in DISPENSABLE.items() for path in folder.results_of(name)]
    found += [(path, "left by an interrupted run") for path in folder.half_stages()]
    return [
        Dispensable(name=str(path.relative_to(folder.root)), size=_size_of(path), what=what)
        for path, what in found
    ]


def remove_dispensable(folder: RunFolder) -> None:
    """Removes the results of the stages in `DISPENSABLE`, and what interrupted stages left.

    Raises:
        BadInputError: Another command is at work on the folder, or it cannot be written.
    """
    with folder.hold():
        folder.remove_results(DISPENSABLE)


def _size_of(path: Path) -> int:
    files = [path] if path.is_file() else [one for one in path.rglob("*") if one.is_file()]
    return sum(one.lstat().st_size for one in files)
