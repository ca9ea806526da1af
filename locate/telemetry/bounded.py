"""Reading telemetry that may be hostile: limits on size, and no output of its parsers."""

from collections.abc import Iterator
from contextlib import contextmanager, redirect_stderr, redirect_stdout
from io import StringIO
from pathlib import Path

from geometry.errors import BadInputError
from geometry.regular_files import read_start
from geometry.text_files import MOST_TEXT_BYTES, decode_text

MAX_TEXT_LINES = 2_000_000
"""Longer texts are refused; chosen."""
MAX_LOG_BYTES = 256 * 2**20
"""Larger binary logs are refused; chosen."""


def read_telemetry_text(path: Path) -> str:
    """The text of a file in UTF-8 or UTF-16; undecodable bytes become U+FFFD.

    Raises:
        BadInputError: The file cannot be read, or is longer than 64 MiB or 2,000,000 lines.
    """
    content = read_start(path, MOST_TEXT_BYTES + 1)
    if len(content) > MOST_TEXT_BYTES:
        raise BadInputError(
            f"{path}: telemetry text over {MOST_TEXT_BYTES // 2**20} MiB is not read; cut out this "
            "flight"
        )
    if content.count(b"\n") > MAX_TEXT_LINES:
        raise BadInputError(
            f"{path}: telemetry of over {MAX_TEXT_LINES} lines is not read; cut out this flight"
        )
    return decode_text(content, errors="replace")


def check_size(path: Path, limit: int = MAX_LOG_BYTES) -> None:
    """Refuses a log that would take too long to read.

    Raises:
        BadInputError: The file is longer than `limit` bytes.
    """
    if path.stat().st_size > limit:
        raise BadInputError(
            f"{path}: a log over {limit // 2**20} MiB is not read; cut out this flight"
        )


@contextmanager
def suppress_output() -> Iterator[None]:
    """Swallows what parsers print about every bad byte."""
    with redirect_stdout(StringIO()), redirect_stderr(StringIO()):
        yield
