"""The .mrk files of DJI's RTK drones: one line for each photo, with centimetres."""

import re
from math import hypot, sqrt
from pathlib import Path

from locate.telemetry.assemble import Record, columns_of, track_from_columns
from locate.telemetry.clock import gps_to_posix_s
from locate.telemetry.track import AltitudeDatum, Clock, TelemetryTrack

KIND = "DJI MRK"
_NUMBER = r"(-?\d{1,9}(?:\.\d{1,12})?)"
_LINE = re.compile(
    rf"^\s{{0,9}}(\d{{1,9}})\s+{_NUMBER}\s+\[(\d{{1,6}})\].{{0,99}}?"
    rf"{_NUMBER},Lat\s+{_NUMBER},Lon\s+{_NUMBER},Ellh\s+"
    rf"{_NUMBER},\s*{_NUMBER},\s*{_NUMBER}\s+(\d{{1,4}}),Q",
    re.MULTILINE,
)


def looks_like_mrk(head: str) -> bool:
    """Whether a text has the labels of a .mrk file."""
    return ",Lat" in head and ",Ellh" in head


def parse_mrk(text: str, path: Path) -> TelemetryTrack:
    """Reads the text of a .mrk file; photos are named by their number.

    The positions are those of the sensor: DJI has already added the offset of the antenna (the
    columns N, E and V; see the manual of the Matrice 4). Heights are ellipsoidal.

    Raises:
        BadInputError: No line can be read.
    """
    lines = _LINE.findall(text)
    lost = sum(1 for line in text.splitlines() if line.strip()) - len(lines)
    records = (_line_record(*(float(number) for number in line[1:])) for line in lines)
    return track_from_columns(
        path,
        KIND,
        columns_of(records),
        datum=AltitudeDatum.ELLIPSOID,
        clock=Clock.UTC,
        names=[line[0] for line in lines],
        warnings=[f"{path.name}: {lost} lines of no known form were left out"] if lost else [],
    )


def _line_record(
    week_seconds: float,
    week: float,
    latitude_deg: float,
    longitude_deg: float,
    altitude_m: float,
    north_sigma_m: float,
    east_sigma_m: float,
    up_sigma_m: float,
    _quality: float,
) -> Record:
    return {
        "clock_s": gps_to_posix_s(week, week_seconds),
        "latitude_deg": latitude_deg,
        "longitude_deg": longitude_deg,
        "altitude_m": altitude_m,
        "horizontal_sigma_m": hypot(north_sigma_m, east_sigma_m) / sqrt(2),
        "vertical_sigma_m": up_sigma_m,
    }
