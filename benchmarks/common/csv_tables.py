"""Tables of results as .csv files, as the docs show them."""

import csv
from collections.abc import Sequence
from pathlib import Path

Row = dict[str, str]
DOCS = Path(__file__).parents[2] / "docs" / "figures"
"""Where the docs have them."""


def write_table(path: Path, rows: Sequence[Row]) -> None:
    """Writes and prints rows that all have the same columns."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, list(rows[0]), lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows)
    print(path.name)
    for row in (dict(zip(rows[0], rows[0], strict=True)), *rows):
        print("  " + " | ".join(row.values()), flush=True)


def read_table(path: Path) -> list[Row]:
    """The rows of such a file."""
    with path.open(newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))
