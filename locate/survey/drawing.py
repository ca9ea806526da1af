"""The drawing of a survey: cells as pictures, hotspots and flights as SVG, in metres."""

from base64 import b64encode
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from html import escape

import cv2
import numpy as np

from geometry.arrays import FloatArray
from locate.export.located import ELLIPSE_SIGMAS
from locate.export.pictures import heat_colours
from locate.survey.cells import CellGrid
from locate.survey.findings import Hotspot
from locate.survey.model import Survey

FAINTEST = 0.12
"""Opacity of a cell of probability 0."""
LEAN_RISE_M = 10.0
"""The line of a hotspot shows how far its column leans over this rise."""
MARGIN = 0.06
"""Around the drawing, in shares of its longer side."""
SCALE_STEPS = 64
"""Colours of the scale beside the map."""
EMPTY_M = 50.0
"""The longer side at least, for the margin."""


@dataclass(frozen=True, kw_only=True)
class MapLayer:
    """One picture of the cells.

    Attributes:
        label: For people.
        shows: What its colours mean.
        top: The value of the strongest colour; 0 has the faintest.
        uri: A PNG as a data URI.
        west_north_size: x and y of its corner and its width and height, m; y points south.
    """

    label: str
    shows: str
    top: float
    uri: str
    west_north_size: tuple[float, float, float, float]


def layers_of(cells: CellGrid | None) -> list[MapLayer]:
    """The probability over all flights, by season and hours, and how often a cell was covered."""
    if cells is None:
        return []
    covered = cells.covered.sum(axis=0)
    all_flights = cells.overall_probability[0]
    values = {"all flights": all_flights}
    if len(cells.bins) > 1:
        values |= {name: cells.in_bin(i) for i, name in enumerate(cells.bins)}
    highest = max(float(np.nanmax(all_flights, initial=0.0)), 1e-6)
    scales = dict.fromkeys(values, ("probability of a plume", highest))
    values["covering flights"] = np.where(covered > 0, covered, np.nan)
    scales["covering flights"] = ("covering flights", max(float(covered.max()), 1.0))
    window, place = _covered_window(cells)
    return [
        MapLayer(
            label=name,
            shows=scales[name][0],
            top=scales[name][1],
            uri=_png_uri(strength[window] / scales[name][1]),
            west_north_size=place,
        )
        for name, strength in values.items()
    ]


def colour_scale_uri() -> str:
    """A PNG of the colours of a layer, from 0 to its top, as a data URI."""
    return _png_uri(np.linspace(0, 1, SCALE_STEPS)[None])


def _covered_window(
    cells: CellGrid,
) -> tuple[tuple[slice, slice], tuple[float, float, float, float]]:
    """The window that holds every covered cell, and its place on the drawing."""
    inside = np.argwhere(cells.covered.any(axis=0))
    if not len(inside):
        inside = np.argwhere(np.ones(cells.shape))
    (bottom, left), (top, right) = inside.min(axis=0), inside.max(axis=0) + 1
    west, north = (cells.low + np.array([left, top])) * cells.cell_m
    size = ((right - left) * cells.cell_m, (top - bottom) * cells.cell_m)
    place = (float(west), -float(north), float(size[0]), float(size[1]))
    return (slice(bottom, top), slice(left, right)), place


def _png_uri(strength: FloatArray) -> str:
    """Hot where 1, faint where 0, transparent where NaN; rows run from south to north."""
    level = np.clip(np.nan_to_num(strength[::-1]), 0, 1).astype(np.float32)
    alpha = np.where(np.isnan(strength[::-1]), 0, FAINTEST + (0.95 - FAINTEST) * np.sqrt(level))
    picture = np.dstack([heat_colours(level), np.rint(255 * alpha).astype(np.uint8)])
    _, content = cv2.imencode(".png", picture)
    return f"data:image/png;base64,{b64encode(content.tobytes()).decode()}"


def draw_map(survey: Survey, layers: Sequence[MapLayer]) -> str:
    """The whole map as an SVG element."""
    paths = [_flight_path(survey, np.array(flight.path_lon_lat)) for flight in survey.mapped]
    x, y, width, height = _map_extent(survey, layers, paths)
    letter = 0.022 * max(width, height)
    parts = [*_layer_images(layers), *_flight_lines(survey, paths)]
    for one in survey.sightings:
        east, north, _ = one.corrected
        parts.append(
            f'<circle class="sighting" cx="{east:.2f}" cy="{-north:.2f}" r="{letter / 8:.2f}">'
            f"<title>{escape(one.flight)}, plume {one.plume}</title></circle>"
        )
    for spot in survey.hotspots:
        parts += _hotspot_marks(spot, letter)
    parts += _scale_bar(x, y, width, height, letter)
    return (
        f'<svg id="map" viewBox="{x:.2f} {y:.2f} {width:.2f} {height:.2f}" role="img" '
        f'aria-label="Map of the survey; the numbers are in the tables below.">'
        f"{''.join(parts)}</svg>"
    )


def _flight_path(survey: Survey, lon_lat: FloatArray) -> FloatArray:
    """(N, 2) east and north of places on the Earth, at the origin's height."""
    heights = np.full(len(lon_lat), survey.frame.height_m)
    return survey.frame.to_enu(np.column_stack([lon_lat[:, ::-1], heights]))[:, :2]


def _map_extent(
    survey: Survey, layers: Sequence[MapLayer], paths: Sequence[FloatArray]
) -> tuple[float, float, float, float]:
    corners = [*paths, np.reshape([spot.position[:2] for spot in survey.hotspots], (-1, 2))]
    for west, top, width, height in {layer.west_north_size for layer in layers}:
        corners.append(np.array([[west, -top], [west + width, -top - height]]))
    points = np.concatenate(corners)
    low, high = points.min(axis=0), points.max(axis=0)
    margin = MARGIN * max(float((high - low).max()), EMPTY_M)
    (west, south), (east, north) = (low - margin).tolist(), (high + margin).tolist()
    return west, -north, east - west, north - south


def _layer_images(layers: Sequence[MapLayer]) -> Iterator[str]:
    for i, layer in enumerate(layers):
        x, y, width, height = layer.west_north_size
        shown = " shown" if i == 0 else ""
        yield (
            f'<image id="layer{i}" class="layer{shown}" href="{layer.uri}" x="{x:.2f}" y="{y:.2f}" '
            f'width="{width:.2f}" height="{height:.2f}" preserveAspectRatio="none"/>'
        )


def _flight_lines(survey: Survey, paths: Sequence[FloatArray]) -> Iterator[str]:
    for flight, path in zip(survey.mapped, paths, strict=True):
        points = " ".join(f"{east:.2f},{-north:.2f}" for east, north in path)
        yield (
            f'<polyline class="flight" points="{points}">'
            f"<title>{escape(flight.name)}</title></polyline>"
        )


def _hotspot_marks(spot: Hotspot, letter: float) -> Iterator[str]:
    east, north, _ = spot.position
    variances, axes = np.linalg.eigh(np.array(spot.covariance)[:2, :2])
    minor, major = ELLIPSE_SIGMAS * np.sqrt(np.maximum(variances, 0.0))
    turn = -np.degrees(np.arctan2(axes[1, 1], axes[0, 1]))
    lean_east, lean_north = (
        LEAN_RISE_M * value / max(spot.axis[2], 0.2) for value in spot.axis[:2]
    )
    total = spot.occurrence[0]
    yield (
        f'<ellipse class="ring" rx="{major:.2f}" ry="{minor:.2f}" '
        f'transform="translate({east:.2f} {-north:.2f}) rotate({turn:.1f})">'
        f"<title>Hotspot {spot.id}: seen by {total.seen:.0f} of {total.looked:.0f}</title>"
        "</ellipse>"
        f'<line class="lean" x1="{east:.2f}" y1="{-north:.2f}" x2="{east + lean_east:.2f}" '
        f'y2="{-north - lean_north:.2f}"/>'
        f'<text x="{east + 0.4 * letter:.2f}" y="{-north - 0.4 * letter:.2f}" '
        f'font-size="{letter:.2f}">{spot.id}</text>'
    )


def _scale_bar(x: float, y: float, width: float, height: float, letter: float) -> Iterator[str]:
    """A bar of a round length, bottom left."""
    power = 10 ** np.floor(np.log10(width / 5))
    length = float(max(step for step in (1, 2, 5) if step * power <= width / 5) * power)
    left, low = x + letter, y + height - letter
    right = left + length
    yield (
        f'<line class="ruler" x1="{left:.2f}" y1="{low:.2f}" x2="{right:.2f}" y2="{low:.2f}"/>'
        f'<text x="{left:.2f}" y="{low - 0.5 * letter:.2f}" font-size="{letter:.2f}">'
        f"{length:g} m</text>"
    )
