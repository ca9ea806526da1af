"""Flights and surveys that lie elsewhere: any address that fsspec knows, such as s3://."""

import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Any

from geometry.atomic import atomic_path
from geometry.errors import BadInputError
from geometry.named_paths import resolve_path
from geometry.regular_files import read_content
from geometry.removal import path_inside
from locate.pipeline.fingerprint import digest
from locate.survey.engine import LOCAL, map_flights
from locate.telemetry.read import SIDECARS

FETCHED = "recordings"
NAME_DIGITS = 10
"""Hexadecimal digits of an address's digest that name its copy."""
STATE = (".json", ".yaml", ".jsonl", ".html", ".geojson", ".gpkg", ".tif", ".cup", ".gpx")
"""Small files that may change and keep their size: always copied."""


def is_address(text: str) -> bool:
    """Whether this is no path of this machine."""
    return "://" in text and not text.startswith("file://")


def local_path(text: str) -> Path:
    """The path of this machine that a text names."""
    return Path(text.removeprefix("file://"))


@dataclass(frozen=True, kw_only=True)
class FetchJob:
    """The job that copies a recording or a run folder here; files that are here are kept.

    Attributes:
        folder: Where to; every worker sees it.
    """

    folder: Path

    def __call__(self, address: str) -> Path:
        """Returns the local path; telemetry beside a video comes with it.

        Raises:
            BadInputError: Nothing is there, or it cannot be read.
        """
        files, root = _open_address(address)
        target = self.folder / digest(address.encode())[:NAME_DIGITS]
        with _report_errors(address):
            if files.isdir(root):
                pull_folder(files, root, target / PurePosixPath(root).name)
            else:
                _pull_with_telemetry(files, PurePosixPath(root), target)
        found = target / PurePosixPath(root).name
        if not found.exists():
            raise BadInputError(f"{address}: nothing is there")
        return found


def fetch_flights(given: Sequence[str], output: Path, scheduler: str | None = None) -> list[Path]:
    """Returns local paths of flights; copies those from elsewhere into the survey's folder.

    Args:
        given: Paths and addresses.
        output: The survey's folder.
        scheduler: As of `map_flights`.

    Raises:
        BadInputError: One cannot be fetched.
    """
    far = [text for text in given if is_address(text)]
    job = FetchJob(folder=resolve_path(output) / FETCHED)
    found = dict(map_flights(job, far, scheduler))
    return [found[text] if text in found else local_path(text) for text in given]


@contextmanager
def mirror_folder(output: str, scheduler: str | None = None) -> Iterator[Path]:
    """Yields the folder of a survey; of one elsewhere, a copy here that is sent back at the end.

    The copy stays in the user's cache, so that adding a flight moves only that flight's files. It
    is sent back as far as it got where the block raises.

    Args:
        output: A path or an address.
        scheduler: As of `map_flights`.

    Raises:
        BadInputError: The address cannot be used, or workers elsewhere would not see the copy.
    """
    if not is_address(output):
        yield local_path(output)
        return
    if scheduler not in (None, LOCAL):
        raise BadInputError(
            f"{output}: the workers of {scheduler} cannot see a copy of it here; give -o a folder "
            "that they share"
        )
    files, root = _open_address(output)
    cache = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    copy = cache / "locate" / digest(output.encode())[:NAME_DIGITS]
    copy.mkdir(parents=True, exist_ok=True)
    with _report_errors(output):
        pull_folder(files, root, copy)
    try:
        yield copy
    finally:
        with _report_errors(output):
            push_folder(copy, files, root)


def pull_folder(files: Any, root: str, target: Path) -> None:
    """Copies a folder of an fsspec file system here; files of the same size stay."""
    if files.exists(root):
        for path, about in files.find(root, detail=True).items():
            inside = path_inside(target, str(PurePosixPath(path).relative_to(root)))
            _pull_file(files, path, about["size"], inside)


def _pull_with_telemetry(files: Any, recording: PurePosixPath, target: Path) -> None:
    """Copies a recording here, and the files beside it that may be its telemetry."""
    beside = {recording.stem.lower() + suffix for suffix in SIDECARS}
    for path in files.ls(str(recording.parent), detail=False):
        name = PurePosixPath(path).name
        if name == recording.name or name.lower() in beside:
            _pull_file(files, path, files.size(path), path_inside(target, name))


def push_folder(folder: Path, files: Any, root: str) -> None:
    """Makes a folder of an fsspec file system like one here, file by file."""
    there = files.find(root, detail=True) if files.exists(root) else {}
    known = {str(PurePosixPath(path).relative_to(root)): path for path in there}
    files_here = (path for path in folder.rglob("*") if path.is_file() and not path.is_symlink())
    here = {str(path.relative_to(folder)): path for path in files_here}
    for name, path in here.items():
        content = read_content(path)
        if name not in known or there[known[name]]["size"] != len(content) or _is_state(path):
            files.makedirs(str(PurePosixPath(root, name).parent), exist_ok=True)
            files.pipe_file(str(PurePosixPath(root, name)), content)
    for name in known.keys() - here.keys():
        files.rm_file(known[name])


def _is_state(path: Path) -> bool:
    return path.suffix in STATE


def _pull_file(files: Any, path: str, size: int, target: Path) -> None:
    if target.exists() and target.stat().st_size == size and not _is_state(target):
        return
    target.parent.mkdir(parents=True, exist_ok=True)
    with atomic_path(target) as unfinished:
        files.get_file(path, str(unfinished))


def _open_address(address: str) -> tuple[Any, str]:
    try:
        from fsspec.core import url_to_fs  # type: ignore[import-untyped]
    except ImportError as error:
        raise BadInputError(f"{address}: pip install 'plume-locate[cluster]' first") from error
    try:
        files, root = url_to_fs(address)
    except (ImportError, ValueError, OSError) as error:
        raise BadInputError(f"{address}: cannot be opened ({error})") from error
    return files, str(root).rstrip("/")


@contextmanager
def _report_errors(address: str) -> Iterator[None]:
    try:
        yield
    except Exception as error:  # no credentials, no network: each store has its own errors
        raise BadInputError(f"{address}: cannot be read or written ({error})") from error
