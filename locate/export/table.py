"""The answer as a table in the terminal."""

from collections.abc import Iterator

import numpy as np
from rich.table import Table

from locate.plume import Bearing, Plume, PlumeMap

Row = tuple[str, str, str]


def map_table(plume_map: PlumeMap) -> Table:
    """Description, value and unit of everything a map says."""
    table = Table(title=plume_map.limit_text(), title_justify="left")
    table.add_column("plume", justify="right")
    table.add_column("quantity")
    table.add_column("value", justify="right")
    table.add_column("unit")
    blocks = [(f"{plume.id}", plume_rows(plume, plume_map.unit_name)) for plume in plume_map.plumes]
    blocks += [(f"{i + 1}", bearing_rows(b)) for i, b in enumerate(plume_map.bearings)]
    for name, rows in blocks:
        for i, row in enumerate(rows):
            table.add_row(name if i == 0 else "", *row)
        table.add_section()
    return table


def plume_rows(plume: Plume, unit: str) -> Iterator[Row]:
    """(description, value, unit) of a plume's quantities."""
    yield "source x, y, z", vector(plume.source), unit
    yield "1-sigma along principal axes", vector(plume.principal_sigmas), unit
    yield "axis of rise", vector(plume.axis), ""
    yield "1-sigma of the axis", f"{np.degrees(plume.axis_sigma_rad):.1f}", "deg"
    yield "seen along the axis", f"{plume.extent_low:.2f} to {plume.extent_high:.2f}", unit
    if len(plume.radius_by_height):
        low, high = plume.radius_by_height[[0, -1], 1]
        yield "radius, bottom to top", f"{low:.2f} to {high:.2f}", unit
    yield "evidence", f"{plume.evidence_nats:.1f}", "nats"
    yield "probability", probability(plume.probability), ""
    yield "mean displacement", f"{plume.displacement_px:.2f}", "px"
    yield "views that saw it", f"{len(plume.views)}", "frames"
    if plume.source_hidden:
        yield "source", "hidden", ""


def bearing_rows(bearing: Bearing) -> Iterator[Row]:
    """(description, value, unit) of a bearing's quantities."""
    yield "direction, camera x right, y down", vector(bearing.direction_in_cam), ""
    yield "1-sigma of the direction", f"{np.degrees(bearing.sigma_rad):.2f}", "deg"
    yield "evidence", f"{bearing.evidence_nats:.1f}", "nats"
    yield "probability", probability(bearing.probability), ""
    yield "mean displacement", f"{bearing.displacement_px:.2f}", "px"


def vector(values: np.ndarray) -> str:
    """Three numbers with three decimals."""
    return ", ".join(f"{value:.3f}" for value in values)


def probability(value: float) -> str:
    """A probability that never rounds to certainty."""
    return "> 0.999" if value > 0.999 else f"{value:.3f}"
