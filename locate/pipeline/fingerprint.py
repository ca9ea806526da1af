"""Digests of inputs and of the code of stages, which change when these do."""

import hashlib
import os
import re
from functools import cache
from importlib.util import find_spec
from pathlib import Path

from geometry.errors import BadInputError
from geometry.regular_files import open_regular, refuse_streams

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
        BadInputError: One cannot be read, or it is a pipe or a device.
    """
    refuse_streams(path)
    summary = hashlib.sha256()
    try:
        files = sorted(p for p in path.iterdir() if p.is_file()) if path.is_dir() else [path]
        for file in files:
            size = file.stat().st_size
            summary.update(os.fsencode(file.relative_to(path.parent)) + f" {size}".encode())
            with open_regular(file) as stream:
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


@cache
def imported_modules(module: str) -> frozenset[str]:
    """The module, its packages, and what these import of this program, at any depth."""
    found: set[str] = set()
    waiting = [module]
    while waiting:
        name = waiting.pop()
        if name not in found and path_of(name) is not None:
            found.add(name)
            waiting += named_in(name)
    return frozenset(found)


@cache
def named_in(module: str) -> frozenset[str]:
    """The package of a module, and every name that it imports: a module's or not."""
    names = {module.rpartition(".")[0]}
    source = TYPES_ONLY.sub("", source_of(module).decode())
    for package, imported, plain in IMPORTS.findall(source):
        names.add(package or plain)
        names.update(f"{package}.{each}" for each in re.findall(r"\w+", imported))
    return frozenset(names)


def source_of(module: str) -> bytes:
    """The source of a module of this program."""
    path = path_of(module)
    return b"" if path is None else path.read_bytes()


@cache
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
