"""How what something costs grows with its size, as the rows of a table."""

from collections.abc import Mapping, Sequence

import numpy as np

from benchmarks.common.csv_tables import Row

LEAST = 1e-2
"""Seconds, or MiB, under which nothing has a measurable growth."""
EXPONENT = "exponent"
"""What the last row of a table is called."""


def growth_rows(
    title: str,
    sizes: Sequence[float],
    costs: Sequence[Mapping[str, float]],
    told: Sequence[Row] | None = None,
) -> list[Row]:
    """A row for each size, and below them the exponents, where there are several sizes.

    Args:
        title: Of the first column, the sizes.
        sizes: Ascending.
        costs: Of each size, by what a column is called; one that a size lacks is 0.
        told: Further columns of each size, which have no exponent.
    """
    names = list(dict.fromkeys(name for cost in costs for name in cost))
    values = {name: [cost.get(name, 0.0) for cost in costs] for name in names}
    rows: list[Row] = []
    for k, size in enumerate(sizes):
        cells = {name: _rounded(values[name][k]) for name in names}
        rows.append({title: _rounded(size)} | (told[k] if told else {}) | cells)
    if len(sizes) > 1:
        fitted = {name: exponent(sizes, values[name]) for name in names}
        rows.append({title: EXPONENT} | dict.fromkeys((told or [{}])[0], "") | fitted)
    return rows


def exponent(sizes: Sequence[float], values: Sequence[float]) -> str:
    """Slope of the logarithm of the values over that of the sizes: 1 is linear."""
    if len(sizes) < 2 or min(values) < LEAST:
        return "-"
    return f"{np.polyfit(np.log(sizes), np.log(values), 1)[0]:.2f}"


def _rounded(value: float) -> str:
    if float(value).is_integer():
        return f"{value:.0f}"
    return f"{value:.2f}" if value < 10 else f"{value:.1f}" if value < 100 else f"{value:.0f}"
