"""Tables with a header line: CSV of any delimiter, exiftool, Airdata, senseFly's geoinfo.

The column names understood are those of `ALIASES`, in any case and spelling of spaces; a unit may
follow in brackets. Everything else is passed over.
"""

import csv
import re
from dataclasses import dataclass
from math import isnan, nan
from pathlib import Path

import numpy as np

from geometry.arrays import FloatArray
from geometry.errors import BadInputError
from locate.telemetry.assemble import ColumnStore, Record, track_from_columns
from locate.telemetry.clock import parse_date_time
from locate.telemetry.track import AltitudeDatum, Clock, TelemetryTrack

KIND = "table"
ALIASES = {
    "name": "filename name image imagename photo file",
    "latitude_deg": "latitude lat gpslatitude latitudedeg",
    "longitude_deg": "longitude lon lng long longtitude gpslongitude longitudedeg",
    "ellipsoid_m": "altitudewgs84 ellipsoidalheight altitudeellipsoid ellh",
    "sea_level_m": "altitudeamsl amsl altitudeabovesealevel altitudemsl",
    "altitude_m": "altitude alt ele elevation absolutealtitude gpsaltitude absalt altitudem",
    "height_m": "heightabovetakeoff relativealtitude relalt height heightm",
    "horizontal_sigma_m": "horizontalsigma hacc horizontalaccuracy eph horizontalsigmam",
    "vertical_sigma_m": "verticalsigma vacc verticalaccuracy epv verticalsigmam",
    "speed_mps": "speed groundspeed speedmps",
    "gimbal_yaw_deg": "gimbalyawdegree gimbalyaw gimbalheading camerayaw gimbalyawdeg",
    "gimbal_pitch_deg": "gimbalpitchdegree gimbalpitch camerapitch gimbalpitchdeg",
    "gimbal_roll_deg": "gimbalrolldegree gimbalroll cameraroll gimbalrolldeg",
    "vehicle_yaw_deg": "flightyawdegree heading compassheading yaw vehicleyawdeg",
    "vehicle_pitch_deg": "flightpitchdegree pitch vehiclepitchdeg",
    "vehicle_roll_deg": "flightrolldegree roll vehiclerolldeg",
    "times_s": "time times t seconds elapsed timestamp",
    "clock_s": "datetime datetimeoriginal utc gpsdatetime date clock datetimeutc",
}
UNITS = {
    "feet": 0.3048,
    "ft": 0.3048,
    "mph": 0.44704,
    "km/h": 1 / 3.6,
    "millisecond": 1e-3,
    "milliseconds": 1e-3,
    "ms": 1e-3,
    "us": 1e-6,
}
ALTITUDES = {
    "ellipsoid_m": AltitudeDatum.ELLIPSOID,
    "sea_level_m": AltitudeDatum.MEAN_SEA_LEVEL,
    "altitude_m": AltitudeDatum.UNKNOWN,
}
_COLUMN_OF = {alias: column for column, names in ALIASES.items() for alias in names.split()}
_TITLE = re.compile(r"([^(\[]{1,60})(?:[(\[]([^)\]]{1,20}))?")
_NUMBER = re.compile(r"[-+]?\d{1,15}(?:\.\d{0,15})?(?:e[-+]?\d{1,3})?", re.IGNORECASE)
_HEADER_LINES = 20
"""The header is within so many lines."""
_FIRST_POSIX_S = 1e8
"""Larger numbers in a column of times are seconds since 1970."""


@dataclass(frozen=True, kw_only=True)
class _TableColumn:
    """A column that is understood: its key of `ALIASES`, its place, its unit and its title."""

    key: str
    index: int
    factor: float
    title: str


def looks_like_table(head: str) -> bool:
    """Whether one of the first lines names a latitude and a longitude."""
    return _find_header(head) is not None


def parse_table(text: str, path: Path) -> TelemetryTrack:
    """Reads a table of positions.

    Coordinates may be decimal, or degrees, minutes and seconds with N, S, E or W. Rows with photo
    names make a track of photos; others need a time. Of several altitudes the ellipsoidal one is
    taken, then the one above sea level.

    Raises:
        BadInputError: No column names for a latitude and a longitude, or nothing under them.
    """
    header = _find_header(text)
    if header is None:
        raise BadInputError(f"{path}: no header line that names a latitude and a longitude")
    start, delimiter, columns = header
    by_photo = next((column.index for column in columns if column.key == "name"), None)
    store, names = ColumnStore(), list[str]()
    try:
        for row in csv.reader(text.splitlines()[start + 1 :], delimiter=delimiter):
            store.add(_row_record(columns, row))
            names += row[by_photo : by_photo + 1] or [""] if by_photo is not None else []
    except csv.Error as error:
        raise BadInputError(f"{path}: not a readable table ({error})") from error
    values = store.arrays()
    return track_from_columns(
        path,
        "senseFly geoinfo" if "sensefly/geoinfo" in text[:200] else KIND,
        values,
        datum=_choose_altitude(values),
        clock=Clock.UTC if "utc" in values else Clock.LOCAL,
        names=None if by_photo is None else names,
    )


def _find_header(text: str) -> tuple[int, str, list[_TableColumn]] | None:
    """Line, delimiter and columns of the header."""
    for line, content in enumerate(text.split("\n", _HEADER_LINES)[:_HEADER_LINES]):
        delimiter = max(",;\t", key=content.count)
        columns = _find_columns(content.split(delimiter))
        if {"latitude_deg", "longitude_deg"} <= {column.key for column in columns}:
            return line, delimiter, columns
    return None


def _find_columns(titles: list[str]) -> list[_TableColumn]:
    """The columns understood, the first of each kind; a file name before a path."""
    found: dict[str, _TableColumn] = {}
    for index, title in enumerate(titles):
        match = _TITLE.match(title.strip().strip('"').lower())
        name, unit = match.groups() if match else ("", None)
        key = _COLUMN_OF.get(re.sub(r"[^a-z0-9]", "", name))
        if key is not None:
            factor = UNITS.get(unit or "", 1.0)
            found.setdefault(key, _TableColumn(key=key, index=index, factor=factor, title=title))
    return list(found.values())


def _row_record(columns: list[_TableColumn], row: list[str]) -> Record:
    record: Record = {}
    for column in columns:
        text = row[column.index] if column.index < len(row) else ""
        if column.key in ("latitude_deg", "longitude_deg"):
            record[column.key] = _parse_degrees(text)
        elif column.key in ("times_s", "clock_s"):
            record |= _time_record(column, text)
        elif column.key != "name":
            record[column.key] = _parse_number(text) * column.factor
    return record


def _time_record(column: _TableColumn, text: str) -> Record:
    seconds, zoned = parse_date_time(text)
    if isnan(seconds):
        seconds = _parse_number(text) * column.factor
        if not abs(seconds) >= _FIRST_POSIX_S:
            return {"times_s": seconds} if column.key == "times_s" else {}
        zoned = True
    is_utc = zoned or "utc" in column.title.lower()
    return {"clock_s": seconds, "utc": 1.0} if is_utc else {"clock_s": seconds}


def _choose_altitude(values: dict[str, FloatArray]) -> AltitudeDatum:
    """Makes the best altitude that the table has its ``altitude_m``."""
    for key, datum in ALTITUDES.items():
        if np.isfinite(values.get(key, np.nan)).any():
            values["altitude_m"] = values[key]
            return datum
    return AltitudeDatum.UNKNOWN


def _parse_degrees(text: str) -> float:
    parts = [abs(float(number)) for number in _NUMBER.findall(text)[:3]]
    if not parts:
        return nan
    whole, minutes, seconds = (*parts, 0.0, 0.0)[:3]
    degrees = whole + minutes / 60 + seconds / 3600
    return -degrees if text.lstrip().startswith("-") or text.rstrip()[-1:] in "SWsw" else degrees


def _parse_number(text: str) -> float:
    found = _NUMBER.search(text)
    return float(found.group()) if found else nan
