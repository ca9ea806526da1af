"""Tracks in GPX, the exchange format of hand-held receivers (extra ``gpx``)."""

from datetime import UTC, datetime
from math import nan
from pathlib import Path
from typing import Any

from geometry.errors import BadInputError, report_as_bad_input
from locate.telemetry.assemble import Record, columns_of, track_from_columns
from locate.telemetry.track import AltitudeDatum, Clock, TelemetryTrack

KIND = "GPX"
MAX_POINTS, MAX_TAGS = 300_000, 2_000_000
"""Larger files are refused before they are parsed; chosen."""


def looks_like_gpx(head: str) -> bool:
    """Whether a text begins like a GPX file."""
    return "<gpx" in head


def parse_gpx(text: str, path: Path) -> TelemetryTrack:
    """Reads all track points of a GPX file; heights are above mean sea level (GPX 1.1 schema).

    Raises:
        BadInputError: Not GPX, no points with times, over 300,000 points, or no extra.
    """
    if text.count("<") > MAX_TAGS or text.count("<trkpt") > MAX_POINTS:
        raise BadInputError(f"{path}: GPX of over {MAX_POINTS} points is not read; cut it")
    if "<!DOCTYPE" in text or "<!ENTITY" in text:
        raise BadInputError(f"{path}: GPX with a document type or entities is not read")
    with report_as_bad_input(path, f"{KIND} file", missing="pip install 'plume-locate[gpx]'"):
        import gpxpy

        columns = columns_of(_point_record(point) for point, *_ in gpxpy.parse(text).walk())
    if not columns:
        raise BadInputError(
            f"{path}: GPX without track points; its waypoints and routes are not where a camera was"
        )
    return track_from_columns(
        path, KIND, columns, datum=AltitudeDatum.MEAN_SEA_LEVEL, clock=Clock.UTC
    )


def _point_record(point: Any) -> Record:
    return {
        "latitude_deg": point.latitude,
        "longitude_deg": point.longitude,
        "altitude_m": nan if point.elevation is None else point.elevation,
        "clock_s": nan if point.time is None else _utc_s(point.time),
    }


def _utc_s(moment: datetime) -> float:
    """Seconds since 1970; a time without a zone is UTC (GPX 1.1 schema), not that of this place."""
    return (moment if moment.tzinfo else moment.replace(tzinfo=UTC)).timestamp()
