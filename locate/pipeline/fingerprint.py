"""What tells an input, or the code of a stage, from another."""

import hashlib
import os
import re
from functools import lru_cache
from importlib.util import find_spec
from pathlib import Path

from geometry.errors import BadInputError

EDGE_BYTES = 1 << 20
"""How much of each end of a file is read."""
PACKAGES = ("geometry", "detect", "locate")
IMPORTS = re.compile(r"^[ \t]*from ([\w.]+) import (\([^)]*\)|[^\n]*)|^[ \t]*import ([\w.]+)", re.M)
TYPES_ONLY = re.compile(r"^if TYPE_CHECKING:\n(?:[ \t]+[^\n]*\n|\n)*", re.M)
"""A block of imports that only a type checker follows."""


def digest(content: bytes) -> str:
    """A hexadecimal SHA-256."""
    return hashlib.sha256(content).hexdigest()


def fingerprint_path(path: Path) -> str:
    """Of a file, or of the files directly in a folder: names, sizes, first and last MiB.

    Raises:
        BadInputError: One cannot be read.
    """
    summary = hashlib.sha256()
    try:
        files = sorted(p for p in path.iterdir() if p.is_file()) if path.is_dir() else [path]
        for file in files:
            size = file.stat().st_size
            summary.update(os.fsencode(file.relative_to(path.parent)) + f" {size}".encode())
            with file.open("rb") as stream:
                summary.update(stream.read(EDGE_BYTES))
                stream.seek(max(0, size - EDGE_BYTES))
                summary.update(stream.read())
    except OSError as error:
        raise BadInputError(f"{error.filename}: cannot be read ({error.strerror})") from error
    return summary.hexdigest()


def fingerprint_code(module: str) -> str:
    """Of the source of a module and of all modules of this program that it imports, at any depth.

    Args:
        module: Its dotted name; one of another program has no fingerprint but its name.
    """
    summary = hashlib.sha256(module.encode())
    for name in sorted(imported_modules(module)):
        summary.update(name.encode() + source_of(name))
    return summary.hexdigest()


@lru_cache
def imported_modules(module: str) -> frozenset[str]:
    """The module, its packages, and what these import of this program, at any depth."""
    found: set[str] = set()
    waiting = [module]
    while waiting:
        name = waiting.pop()
        if name in found or path_of(name) is None:
            continue
        found.add(name)
        waiting.append(name.rpartition(".")[0])
        source = TYPES_ONLY.sub("", source_of(name).decode())
        for package, names, plain in IMPORTS.findall(source):
            waiting.append(package or plain)
            waiting += [f"{package}.{each}" for each in re.findall(r"\w+", names)]
    return frozenset(found)


def source_of(module: str) -> bytes:
    """The source of a module of this program."""
    path = path_of(module)
    return b"" if path is None else path.read_bytes()


@lru_cache
def path_of(module: str) -> Path | None:
    """The file of a module of this program; None where there is no such module."""
    package, *parts = module.split(".")
    if package not in PACKAGES:
        return None
    spec = find_spec(package)
    if spec is None or spec.origin is None:
        return None
    place = Path(spec.origin).parent.joinpath(*parts)
    candidates = (place / "__init__.py", place.with_suffix(".py"))
    return next((path for path in candidates if path.is_file()), None)
