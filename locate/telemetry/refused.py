"""What of a file was refused, and the lines that say so."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from geometry.arrays import FloatArray
from geometry.errors import BadInputError

_SHOWN = 40
"""Characters of a refused text that are shown."""


class RefusedPositionsError(BadInputError):
    """A file of positions, none of which has a known form."""


@dataclass(frozen=True)
class RefusedText:
    """A cell or tuple of no known form.

    Attributes:
        line: Its line in the file, from 1; 0 where there are no lines.
        what: The title of its column, or what it is.
        text: What stands there.
        why: What is wrong with it.
        is_position: Whether the record has no position for it.
    """

    line: int
    what: str
    text: str
    why: str
    is_position: bool

    def __str__(self) -> str:
        at = f"line {self.line}: " if self.line else ""
        shown = " ".join(self.text.split())
        shown = shown if len(shown) <= _SHOWN else shown[:_SHOWN] + "..."
        return f"{at}{self.what} {shown!r}: {self.why}"


def raise_if_all_refused(
    path: Path, values: Mapping[str, FloatArray], refused: Sequence[RefusedText]
) -> None:
    """Refuses a file whose positions all are of no known form.

    Args:
        path: The file.
        values: (N,) columns by name.
        refused: What was refused of it.

    Raises:
        RefusedPositionsError: There is no position, and some were refused; it names the first.
    """
    known = np.isfinite(values.get("latitude_deg", np.nan))
    first = next((entry for entry in refused if entry.is_position), None)
    if first is not None and not known.any():
        advice = "; write decimal degrees such as -33.8688, or 33 52 7.7 S" if first.line else ""
        raise RefusedPositionsError(f"{path}, {first}{advice}")


def summarize_refused(path: Path, refused: Sequence[RefusedText]) -> tuple[str, ...]:
    """One warning for each column with refused texts: how many, and the first of them."""
    first: dict[str, RefusedText] = {}
    counts: dict[str, int] = {}
    for entry in refused:
        first.setdefault(entry.what, entry)
        counts[entry.what] = counts.get(entry.what, 0) + 1
    return tuple(
        f"{path.name}: {counts[what]} of the values under {what} left out, being of no known "
        f"form (the first: {entry})"
        for what, entry in first.items()
    )
