"""The answer as a table in the terminal."""

from collections.abc import Iterator

import numpy as np
from rich.table import Table

from locate.export.located import LocatedPlume, plumes_on_earth
from locate.map.plume import Bearing, Plume, PlumeMap

Row = tuple[str, str, str]

AGAINST_AIR = {"lower": "below the air's", "higher": "above the air's", None: "not determined"}


def map_table(plume_map: PlumeMap) -> Table:
    """Description, value and unit of everything in a map."""
    table = Table(title=plume_map.limit_text(), title_justify="left")
    table.add_column("plume", justify="right")
    table.add_column("quantity")
    table.add_column("value", justify="right")
    table.add_column("unit")
    for kind, rows in answer_rows(plume_map):
        name = kind.split()[-1]
        for i, row in enumerate(rows):
            table.add_row(name if i == 0 else "", *row)
        table.add_section()
    return table


def advice_lines(plume_map: PlumeMap) -> Iterator[str]:
    """What to film instead where nothing could be judged, and what else is in the way.

    The first obstacle is named in `PlumeMap.limit_text`.
    """
    for number, obstacle in enumerate(plume_map.obstacles):
        if number:
            yield f"- {obstacle.why}"
        yield f"  Instead: {obstacle.remedy[0].lower()}{obstacle.remedy[1:]}"


def answer_rows(plume_map: PlumeMap) -> Iterator[tuple[str, list[Row]]]:
    """Everything that was found, by its name ("Plume 1", "Bearing 2"), and its quantities."""
    places = (
        plumes_on_earth(plume_map) if plume_map.georeference else [None] * len(plume_map.plumes)
    )
    for plume, place in zip(plume_map.plumes, places, strict=True):
        rows = [*plume_rows(plume, plume_map.unit_name)]
        yield f"Plume {plume.id}", [*(place_rows(place) if place else ()), *rows]
    for number, bearing in enumerate(plume_map.bearings, start=1):
        yield f"Bearing {number}", [*bearing_rows(bearing)]


def place_rows(place: LocatedPlume) -> Iterator[Row]:
    """(description, value, unit) of where on the Earth a source is."""
    yield "latitude, longitude (WGS84)", f"{place.lat_deg:.7f}, {place.lon_deg:.7f}", "deg"
    yield f"height above {place.datum.words}", f"{place.height_m:.2f}", "m"


def plume_rows(plume: Plume, unit: str) -> Iterator[Row]:
    """(description, value, unit) of a plume's quantities."""
    yield "source x, y, z", vector_text(plume.source), unit
    yield "1-sigma along principal axes", vector_text(plume.principal_sigmas), unit
    yield "axis of rise", vector_text(plume.axis), ""
    yield "1-sigma of the axis", f"{np.degrees(plume.axis_sigma_rad):.1f}", "deg"
    yield "seen along the axis", f"{plume.extent_low:.2f} to {plume.extent_high:.2f}", unit
    if len(plume.radius_by_height):
        low, high = plume.radius_by_height[[0, -1], 1]
        yield "radius, bottom to top", f"{low:.2f} to {high:.2f}", unit
    yield "evidence", f"{plume.evidence_nats:.1f}", "nats"
    yield "probability", probability_text(plume.probability), ""
    yield "mean displacement", f"{plume.displacement_px:.2f}", "px"
    yield "views that saw it", f"{len(plume.views)}", "frames"
    yield "refractive index", AGAINST_AIR[plume.refractive_index], ""
    if plume.source_hidden:
        yield "source", "hidden", ""


def bearing_rows(bearing: Bearing) -> Iterator[Row]:
    """(description, value, unit) of a bearing's quantities."""
    yield "direction, camera x right, y down", vector_text(bearing.direction_in_cam), ""
    yield "1-sigma of the direction", f"{np.degrees(bearing.sigma_rad):.2f}", "deg"
    yield "evidence", f"{bearing.evidence_nats:.1f}", "nats"
    yield "probability", probability_text(bearing.probability), ""
    yield "mean displacement", f"{bearing.displacement_px:.2f}", "px"


def vector_text(values: np.ndarray) -> str:
    """Three numbers with three decimals."""
    return ", ".join(f"{value:.3f}" for value in values)


def probability_text(value: float) -> str:
    """A probability that never rounds to certainty."""
    return "> 0.999" if value > 0.999 else f"{value:.3f}"
