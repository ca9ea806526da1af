"""A survey as a GeoPackage: hotspots, sightings, cells, flights, and their styles."""

import re
from pathlib import Path
from sqlite3 import Connection
from typing import Any

import numpy as np

from geometry.arrays import FloatArray
from geometry.covariance import standard_deviations
from geometry.georeference import Georeference
from locate.export.geopackage import (
    WGS84_2D,
    add_layer,
    add_reference_systems,
    line_blob,
    new_geopackage,
    point_blob,
    polygon_blob,
)
from locate.export.layer_styles import add_styles, area, graduated, line, marker, single
from locate.export.report.pictures import heat_stops
from locate.survey.cells import CellGrid
from locate.survey.model import Survey
from locate.survey.places import located_hotspots

HOTSPOT_COLOR, SIGHTING_COLOR, FLIGHT_COLOR = "#009e73", "#1b1d21", "#0072b2"
CLASSES = 5
"""Of the probability of a cell."""
RING = np.array([[0, 0], [1, 0], [1, 1], [0, 1], [0, 0]])


def write_layers(path: Path, survey: Survey, cells: CellGrid | None) -> None:
    """Writes the GeoPackage; the layer ``cells`` holds those that were covered."""
    with new_geopackage(path) as file:
        srs = add_reference_systems(file, survey.frame.datum)
        _add_points(
            file,
            "hotspots",
            srs,
            [place.properties() for place in located_hotspots(survey)],
            _lon_lat_height(survey.frame, [spot.position for spot in survey.hotspots]),
        )
        _add_points(
            file,
            "sightings",
            srs,
            _sighting_fields(survey),
            _lon_lat_height(survey.frame, [one.corrected for one in survey.sightings]),
        )
        _add_cells(file, survey, cells)
        _add_flights(file, survey)
        add_styles(file, _styles(cells))


def _styles(cells: CellGrid | None) -> dict[str, str]:
    """As map.html draws them."""
    top = 1.0
    if cells is not None:
        top = max(float(np.nanmax(cells.overall_probability[0], initial=0.0)), 1e-6)
    shades = [
        area(color, opacity)
        for color, opacity in zip(heat_stops(CLASSES), np.linspace(0.2, 0.9, CLASSES), strict=True)
    ]
    return {
        "hotspots": single(marker(HOTSPOT_COLOR, 4.0), label="hotspot"),
        "sightings": single(marker(SIGHTING_COLOR, 1.6)),
        "cells": graduated("probability", np.linspace(0, top, CLASSES + 1).tolist(), shades),
        "flights": single(line(FLIGHT_COLOR, 0.3)),
    }


def _lon_lat_height(frame: Georeference, points: list[Any]) -> FloatArray:
    return frame.lat_lon_height(np.reshape(points, (-1, 3)))[:, [1, 0, 2]]


def _add_points(
    file: Connection, table: str, srs: int, rows: list[dict[str, Any]], places: FloatArray
) -> None:
    blobs = [point_blob(srs, place) for place in places]
    add_layer(file, table, ("POINT", srs, 1), rows, blobs, places[:, :2])


def _sighting_fields(survey: Survey) -> list[dict[str, Any]]:
    rows = []
    for one in survey.sightings:
        east, north, up = standard_deviations(np.array(one.covariance)).tolist()
        rows.append(
            {
                "flight": one.flight,
                "plume": one.plume,
                "hotspot": one.hotspot,
                "weight": one.weight,
                "sigma_east_m": east,
                "sigma_north_m": north,
                "sigma_up_m": up,
            }
        )
    return rows


def _add_cells(file: Connection, survey: Survey, cells: CellGrid | None) -> None:
    rows: list[dict[str, Any]] = []
    rings = np.zeros((0, len(RING), 2))
    if cells is not None:
        covered, seen = cells.covered.sum(axis=0), cells.seen.sum(axis=0)
        where = np.argwhere(covered > 0)
        mean, low, high = cells.overall_probability
        limit_px = np.where(np.isfinite(cells.limit_px), cells.limit_px, np.nan)
        by_bin = {column_name(name): cells.in_bin(i) for i, name in enumerate(cells.bins)}
        rows = [
            {
                "looked": float(covered[r, c]),
                "seen": float(seen[r, c]),
                "probability": float(mean[r, c]),
                "low": float(low[r, c]),
                "high": float(high[r, c]),
                "limit_px": float(limit_px[r, c]),
                **{name: float(values[r, c]) for name, values in by_bin.items()},
            }
            for r, c in where
        ]
        corners = (cells.low + where[:, ::-1])[:, None] + RING
        flat = np.dstack([corners * cells.cell_m, np.zeros(corners.shape[:2])])
        rings = _lon_lat_height(survey.frame, flat.reshape(-1, 3).tolist())[:, :2]
        rings = rings.reshape(-1, len(RING), 2)
    blobs = [polygon_blob(ring) for ring in rings]
    add_layer(file, "cells", ("POLYGON", WGS84_2D, 0), rows, blobs, rings.reshape(-1, 2))


def column_name(bin_name: str) -> str:
    """Of the probability in one bin: ``probability_summer_12_15_h``."""
    return f"probability_{re.sub(r'[^a-z0-9]+', '_', bin_name)}"


def _add_flights(file: Connection, survey: Survey) -> None:
    rows = [
        {
            "name": flight.name,
            "date": None if flight.moment is None else flight.moment.local.date(),
            "hour": np.nan if flight.moment is None else flight.moment.hour,
            "day_of_year": np.nan if flight.moment is None else float(flight.moment.day_of_year),
            "plumes": len(flight.plume_map.plumes),
        }
        for flight in survey.mapped
    ]
    paths = [np.array(flight.path_lon_lat) for flight in survey.mapped]
    blobs = [line_blob(path) for path in paths]
    add_layer(file, "flights", ("LINESTRING", WGS84_2D, 0), rows, blobs, np.concatenate(paths))
