"""Plain text, JSON and YAML from files that may be hostile."""

from codecs import BOM_UTF8, BOM_UTF16_BE, BOM_UTF16_LE
from collections.abc import Callable
from pathlib import Path
from typing import Any

from geometry.errors import BadInputError
from geometry.json_text import parse_json
from geometry.regular_files import open_regular, read_start
from geometry.yaml_text import parse_yaml

MOST_TEXT_BYTES = 64 * 2**20
"""Longest text that is read: poses of some hundred thousand frames; chosen."""
WIDE = (BOM_UTF16_LE, BOM_UTF16_BE)
"""Byte order marks of UTF-16."""


def decode_text(content: bytes, errors: str = "strict") -> str:
    """A text in UTF-8, or in UTF-16 where it begins with a byte order mark, which is left out.

    Args:
        content: The bytes.
        errors: As of `bytes.decode`.

    Raises:
        UnicodeDecodeError: The bytes are neither, and `errors` is "strict".
    """
    return content.decode("utf-16" if content.startswith(WIDE) else "utf-8-sig", errors)


def has_mark(path: Path) -> bool:
    """Whether a text file begins with a byte order mark.

    Raises:
        OSError: It cannot be read.
    """
    with open_regular(path) as file:
        return file.read(len(BOM_UTF8)).startswith((BOM_UTF8, *WIDE))


def read_text(path: Path) -> str:
    """The text of a file in UTF-8 or UTF-16.

    Raises:
        BadInputError: It cannot be read, is longer than 64 MiB, or no text.
    """
    content = read_start(path, MOST_TEXT_BYTES + 1)
    if len(content) > MOST_TEXT_BYTES:
        raise BadInputError(f"{path}: a text over {MOST_TEXT_BYTES // 2**20} MiB is not read")
    try:
        return decode_text(content)
    except UnicodeDecodeError as error:
        raise BadInputError(f"{path}: no text in UTF-8 or UTF-16; save it as UTF-8") from error


def read_json(path: Path) -> Any:
    """The content of a JSON file.

    Raises:
        BadInputError: It cannot be read, or is no JSON that `parse_json` takes.
    """
    return _parse_file(path, parse_json)


def read_yaml(path: Path) -> Any:
    """The content of a YAML file.

    Raises:
        BadInputError: It cannot be read, or is no YAML that `parse_yaml` takes.
    """
    return _parse_file(path, parse_yaml)


def _parse_file(path: Path, parse: Callable[[str], Any]) -> Any:
    try:
        return parse(read_text(path))
    except ValueError as error:
        raise BadInputError(f"{path}: {error}") from error
