"""Holds the ratios of a run of `benchmarks.peers` and `benchmarks.bounds` against the stored ones.

    python -m benchmarks.peers compare NEW_DIR [--stored DIR]

Ratios only, never times: how often a peer takes our CPU seconds, and how far we are from a bound.
Ends with exit code 1 where one is worse by more than `MOST_LOSS`; peers that either lacks are not
compared.
"""

import argparse
import re
from collections.abc import Iterator
from itertools import takewhile
from pathlib import Path

from benchmarks.common.csv_tables import DOCS, Row, read_table
from geometry.errors import BadInputError

MOST_LOSS = 0.3
"""Share by which a ratio may be worse: CPU seconds of a shared machine vary by a fifth."""
OF_OURS, OF_BOUND = ", of ours", ", of the bound"
"""Columns of ratios: the first should be large, the second small."""
NUMBER = re.compile(r"[-+]?\d")
PATTERNS = ("peers_*.csv", "bounds_*.csv")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("new", type=Path)
    parser.add_argument("--stored", type=Path, default=DOCS)


def main(options: argparse.Namespace) -> None:
    tables = sorted(path for pattern in PATTERNS for path in options.new.glob(pattern))
    if not tables:
        raise BadInputError(f"{options.new}: no table of peers or bounds; run these first")
    losses = [loss for table in tables for loss in losses_of(table, options.stored / table.name)]
    print("\n".join(losses) or f"{len(tables)} tables: no ratio is worse")
    raise SystemExit(bool(losses))


def losses_of(new: Path, stored: Path) -> Iterator[str]:
    """What is worse in a table, in lines."""
    before = {} if not stored.exists() else {key_of(row): row for row in read_table(stored)}
    for row in read_table(new):
        old = before.get(key_of(row), {})
        for column in row.keys() & old.keys():
            if is_worse(column, row[column], old[column]):
                what = " ".join(key_of(row))
                yield f"{new.name}: {what}: {column} was {old[column]} and is {row[column]}"


def key_of(row: Row) -> tuple[str, ...]:
    """The cells that name a row: the first, and those before the first number."""
    first, *others = row.values()
    return (first, *takewhile(lambda cell: not NUMBER.match(cell), others))


def is_worse(column: str, new: str, old: str) -> bool:
    if column.endswith(OF_OURS):
        return float(new) < (1 - MOST_LOSS) * float(old)
    return column.endswith(OF_BOUND) and float(new) > (1 + MOST_LOSS) * float(old)
