"""The map page: one HTML file that works without a network."""

from collections.abc import Iterable, Sequence
from html import escape
from pathlib import Path

from locate.export.html import definition_rows, html_table, list_items, read_resource, write_page
from locate.export.table import probability_text
from locate.survey.cells import CellGrid
from locate.survey.drawing import MapLayer, colour_scale_uri, draw_map, layers_of
from locate.survey.findings import Hotspot
from locate.survey.model import Flight, Survey
from locate.survey.places import LocatedHotspot, located_hotspots

MARKS = (
    ('<circle class="ring" r="5.5"/>', "hotspot, in the ring 95 times of 100"),
    ('<line class="lean" x1="-6" y1="5" x2="6" y2="-5"/>', "lean of its columns in 10 m of rise"),
    ('<circle class="sighting" r="3"/>', "sighting: a plume of one flight"),
    ('<line class="flight" x1="-7" x2="7"/>', "flight"),
)
"""What the map draws, and what it means."""
FLIGHT_HEADS = ("Flight", "When", "Plumes", "Lean", "")


def write_map_page(path: Path, survey: Survey, cells: CellGrid | None) -> None:
    """Writes map.html."""
    layers = layers_of(cells)
    spots = [_spot_row(place) for place in located_hotspots(survey)]
    fragments = {
        "choices": _choices([layer.label for layer in layers]),
        "legend": _legend(layers),
        "map": draw_map(survey, layers),
        "hotspots": html_table(_spot_heads(survey), spots) if spots else "<p>None.</p>",
        "flights": html_table(
            FLIGHT_HEADS, [_flight_row(survey, flight) for flight in survey.flights]
        ),
        "limits": list_items(_limits(survey)),
        "settings": definition_rows(_settings(survey)),
    }
    write_page(
        path,
        "survey",
        kind="Updraft map",
        headline=_headline(survey),
        lead=_lead(survey, cells),
        facts=_facts(survey, cells),
        fragments=fragments,
        scripts=[read_resource("survey/map.js")],
    )


def _headline(survey: Survey) -> str:
    count, flights = len(survey.hotspots), len(survey.mapped)
    spots = {0: "No hotspot", 1: "One hotspot"}.get(count, f"{count} hotspots")
    return f"{spots} from {flights} flight{'s' if flights != 1 else ''}"


def _lead(survey: Survey, cells: CellGrid | None) -> str:
    if not survey.hotspots:
        if cells is not None and cells.covered.any():
            return "Nothing was seen; the map shows the ground that was covered."
        size = f"{survey.column.displacement_px:.2g} px"
        return f"Nothing was seen, and nowhere would a column of {size} have been found."
    total = survey.hotspots[0].occurrence[0]
    return (
        f"The one seen most often was seen by {total.seen:.0f} of the {total.looked:.0f} flights "
        f"that covered it: it is present with probability {total.probability:.2f} "
        f"({total.low:.2f} to {total.high:.2f})."
    )


def _facts(survey: Survey, cells: CellGrid | None) -> Iterable[tuple[str, str]]:
    frame = survey.frame
    yield "Origin", f"{frame.lat_deg:.6f}, {frame.lon_deg:.6f}, {frame.name}"
    yield "Sightings", str(len(survey.sightings))
    if cells is not None:
        hectares = float((cells.covered.sum(axis=0) > 0).sum()) * cells.cell_m**2 / 1e4
        yield "Covered", f"{hectares:.2g} ha in cells of {cells.cell_m:g} m"
        yield (
            "Covered means able to detect",
            f"columns of {survey.column.displacement_px:.2g} px and more",
        )


def _choices(labels: Sequence[str]) -> str:
    choices = (
        f'<label><input type="radio" name="layer" value="layer{i}"{" checked" if i == 0 else ""}> '
        f"{escape(label)}</label>"
        for i, label in enumerate(labels)
    )
    return f'<fieldset class="choices">{"".join(choices)}</fieldset>' if labels else ""


def _legend(layers: Sequence[MapLayer]) -> str:
    """The colours of each layer, of which the page shows the chosen one, and the marks."""
    picture = f'<img src="{colour_scale_uri()}" alt="">' if layers else ""
    scales = (
        f'<p class="scale layer{" shown" if i == 0 else ""}" data-layer="layer{i}">0 {picture} '
        f"{layer.top:.2g} {layer.shows}</p>"
        for i, layer in enumerate(layers)
    )
    marks = (
        f'<li><svg class="mark" viewBox="-8 -8 16 16" aria-hidden="true">{mark}</svg> {text}</li>'
        for mark, text in MARKS
    )
    return f'{"".join(scales)}<ul class="marks">{"".join(marks)}</ul>'


def _spot_heads(survey: Survey) -> tuple[str, ...]:
    return (
        "Hotspot", "Latitude, longitude (WGS84)", f"Height above {survey.frame.datum.words}",
        "1 sigma east, north", "Seen of covered", "Present with probability",
        "By season and hours", "No false alarm",
    )  # fmt: skip


def _spot_row(place: LocatedHotspot) -> list[str]:
    fields, spot = place.properties(), place.hotspot
    total = spot.occurrence[0]
    return [
        str(spot.id),
        f"{place.lat_deg:.6f}, {place.lon_deg:.6f}",
        f"{place.height_m:.1f} m",
        f"{fields['sigma_east_m']:.2g} m, {fields['sigma_north_m']:.2g} m",
        f"{total.seen:.0f} of {total.looked:.0f}",
        f"{total.probability:.2f} ({total.low:.2f} to {total.high:.2f})",
        _by_bin(spot),
        probability_text(spot.probability),
    ]


def _by_bin(spot: Hotspot) -> str:
    return "; ".join(
        f"{count.bin}: {count.seen:.0f} of {count.looked:.0f}" for count in spot.occurrence[1:]
    )


def _flight_row(survey: Survey, flight: Flight) -> list[str]:
    if flight.failure is not None:
        return [flight.name, "", "", "", f"left out: {flight.failure}"]
    wind = next((wind for wind in survey.winds if wind.flight == flight.name), None)
    when = "not known" if flight.moment is None else f"{flight.moment.local:%Y-%m-%d %H:%M}"
    lean = ""
    if wind is not None:
        size = float((wind.lean[0] ** 2 + wind.lean[1] ** 2) ** 0.5)
        lean = f"{size:.2f} +- {wind.sigma:.2f} m per m, wind from {wind.from_deg:.0f} deg"
    return [flight.name, when, str(len(flight.plume_map.plumes)), lean, ""]


def _limits(survey: Survey) -> Iterable[str]:
    mean, weight = survey.prior
    column = survey.column
    yield (
        f"A flight covered a cell where its evidence would have carried a column of "
        f"{column.displacement_px:.2g} px, {column.radius_m:.2g} m in radius and "
        f"{column.height_m:.2g} m high, over its threshold; near that limit half are missed, and "
        "weaker ones nearly always."
    )
    yield (
        f"The probability of a cell is the mean of a Beta posterior; its prior is worth "
        f"{weight:g} flight with mean {mean:.3g}, the share of covering flights with a sighting in "
        "the whole survey."
    )
    yield "That of a hotspot allows for its being known only because it was seen."
    yield (
        f"Columns of one hotspot were assumed to be {survey.settings.wander_m:g} m (1 sigma) "
        f"from it, and {survey.drift_m:.1f} +- {survey.drift_sigma_m:.1f} m further downwind per "
        "unit of lean."
    )
    yield from survey.notes


def _settings(survey: Survey) -> Iterable[tuple[str, object]]:
    yield "version", survey.version
    yield from (
        (name, value)
        for name, value in survey.settings.model_dump(mode="json").items()
        if value is not None
    )
