"""Tables with a header line: CSV of any delimiter, exiftool, Airdata, senseFly's geoinfo.

The column names understood are those of `ALIASES`, in any case and spelling of spaces; a unit may
follow in brackets. Other columns are passed over. A cell of a known column that is of no known
form is refused: its row has no position, or lacks that value, and the track's warnings say so.
"""

import csv
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from math import isfinite, isnan, nan
from pathlib import Path
from typing import TypeAlias

import numpy as np

from geometry.arrays import FloatArray
from geometry.errors import BadInputError
from locate.telemetry.assemble import ColumnStore, Record, track_from_columns
from locate.telemetry.cells import (
    ANGLES,
    DAY_S,
    DURATIONS,
    LENGTHS,
    SIDES,
    SPEEDS,
    UnknownForm,
    parse_clock_time,
    parse_coordinate,
    parse_date,
    parse_quantity,
    parse_stamp,
)
from locate.telemetry.refused import RefusedText, raise_if_all_refused, summarize_refused
from locate.telemetry.track import AltitudeDatum, Clock, TelemetryTrack

KIND = "table"
ALIASES = {
    "name": "filename name image imagename photo file",
    "path": "sourcefile",
    "label": "label",
    "latitude_deg": "latitude lat gpslatitude latitudedeg latitudens ylatitude",
    "longitude_deg": "longitude lon lng long longtitude gpslongitude longitudedeg longitudeew "
    "xlongitude",
    "latitude_ref": "gpslatituderef latituderef latref ns latdir latitudedirection",
    "longitude_ref": "gpslongituderef longituderef lonref lngref ew londir longitudedirection",
    "altitude_ref": "gpsaltituderef altituderef",
    "ellipsoid_m": "altitudewgs84 ellipsoidalheight altitudeellipsoid ellh",
    "sea_level_m": "altitudeamsl amsl altitudeabovesealevel altitudemsl",
    "altitude_m": "altitude alt ele elevation absolutealtitude gpsaltitude absalt altitudem "
    "zaltitude",
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
    "clock_s": "datetime datetimeoriginal utc gpsdatetime clock datetimeutc",
    "day": "date day",
}
UNITS_OF = {
    "latitude_deg": ANGLES,
    "longitude_deg": ANGLES,
    "ellipsoid_m": LENGTHS,
    "sea_level_m": LENGTHS,
    "altitude_m": LENGTHS,
    "height_m": LENGTHS,
    "horizontal_sigma_m": LENGTHS,
    "vertical_sigma_m": LENGTHS,
    "speed_mps": SPEEDS,
    "times_s": DURATIONS,
}
"""Units by column; those of angles elsewhere."""
_NO_UNITS = {"", "utc", "local", "gmt", "wgs84", "msl", "amsl", "egm96", "ellipsoid", "posix"}
"""What else may stand in the brackets of a title."""
_TEXTS = (
    "name",
    "path",
    "label",
    "latitude_ref",
    "longitude_ref",
    "altitude_ref",
    "clock_s",
    "day",
)
_MOMENTS = ("clock_s", "of_day_s", "times_s")
_SIGNED_HEIGHTS = {"1", "3", "below sea level"}
_UNSIGNED_HEIGHTS = {"", "0", "2", "above sea level"}
"""Of GPSAltitudeRef, EXIF 3.0, table 17, as exiftool writes it."""
ALTITUDES = {
    "ellipsoid_m": AltitudeDatum.ELLIPSOID,
    "sea_level_m": AltitudeDatum.MEAN_SEA_LEVEL,
    "altitude_m": AltitudeDatum.UNKNOWN,
}
_COLUMN_OF = {alias: column for column, names in ALIASES.items() for alias in names.split()}
_TITLE = re.compile(r"([^(\[]{1,60})(?:[(\[]([^)\]]{1,20}))?")
_GROUP = re.compile(r"(?:exif|gps|xmp|xmp-[a-z-]{1,20}|composite|file|system|ifd0):")
_UNSIGNED_GROUPS = ("exif", "gps")
"""Groups of exiftool whose coordinates have their sign in another column."""
_HEADER_LINES = 20
"""The header is within so many lines."""
_FIRST_POSIX_S, _LAST_POSIX_S = 1e8, 4e9
"""Larger numbers in a column of times are counts since 1970, and what these are in seconds."""


@dataclass(frozen=True, kw_only=True)
class _TableColumn:
    """A column that is understood.

    Attributes:
        key: Of `ALIASES`.
        index: Its place.
        unit: What its title has in brackets; empty without.
        title: As the file has it.
        is_signed: False for coordinates whose sign stands in another column.
    """

    key: str
    index: int
    unit: str
    title: str
    is_signed: bool


_Columns: TypeAlias = Mapping[str, _TableColumn]


def looks_like_table(head: str) -> bool:
    """Whether one of the first lines names a latitude and a longitude."""
    return _find_header(head) is not None


def parse_table(text: str, path: Path) -> TelemetryTrack:
    """Reads a table of positions.

    Coordinates may be decimal, or degrees, minutes and seconds with N, S, E or W, also in columns
    of their own. Rows with photo names make a track of photos; others need a time. Of several
    altitudes the ellipsoidal one is taken, then the one above sea level.

    Raises:
        BadInputError: No column names for a latitude and a longitude, nothing under them, or no
            position of a known form.
    """
    header = _find_header(text)
    if header is None:
        raise BadInputError(f"{path}: no header line that names a latitude and a longitude")
    start, delimiter, width, columns = header
    _check_units(columns, path, start + 1)
    by_photo = columns.get("name", columns.get("path"))
    if by_photo is None and not {"times_s", "clock_s"} & columns.keys():
        by_photo = columns.get("label")  # of Metashape; beside times it may be anything
    store, names, refused = ColumnStore(), list[str](), list[RefusedText]()
    try:
        for line, row in _read_rows(text, start, delimiter):
            store.add(_row_record(columns, row, width, line, refused))
            if by_photo is not None:
                names.append(row[by_photo.index] if by_photo.index < len(row) else "")
    except csv.Error as error:
        raise BadInputError(f"{path}: not a readable table ({error})") from error
    values = store.arrays()
    raise_if_all_refused(path, values, refused)
    if by_photo is None:
        _raise_if_no_time(columns, values, path, refused)
    _count_on_past_midnight(values)
    return track_from_columns(
        path,
        "senseFly geoinfo" if "sensefly/geoinfo" in text[:200] else KIND,
        values,
        datum=_choose_altitude(values),
        clock=Clock.UTC if "utc" in values else Clock.LOCAL,
        names=None if by_photo is None else names,
        warnings=summarize_refused(path, refused),
    )


def _read_rows(text: str, start: int, delimiter: str) -> Iterator[tuple[int, list[str]]]:
    """Line number and cells of each row below the header that holds anything."""
    reader = csv.reader(text.splitlines()[start + 1 :], delimiter=delimiter)
    for row in reader:
        if any(cell.strip() for cell in row):
            yield start + 1 + reader.line_num, row


def _find_header(text: str) -> tuple[int, str, int, _Columns] | None:
    """Line, delimiter, number of titles and columns of the header."""
    for line, content in enumerate(text.split("\n", _HEADER_LINES)[:_HEADER_LINES]):
        delimiter = max(",;\t", key=content.count)
        titles = content.strip("\r").split(delimiter)
        columns = _find_columns(titles)
        if {"latitude_deg", "longitude_deg"} <= columns.keys():
            return line, delimiter, len(titles), columns
    return None


def _find_columns(titles: list[str]) -> _Columns:
    """The columns understood, the first of each kind, and one with a sign before one without."""
    found: dict[str, _TableColumn] = {}
    for index, title in enumerate(titles):
        plain = title.strip().strip('"').lower()
        group = _GROUP.match(plain)
        match = _TITLE.match(plain[group.end() :] if group else plain)
        name, unit = match.groups() if match else ("", None)
        key = _COLUMN_OF.get(re.sub(r"[^a-z0-9]", "", name))
        if key is not None:
            is_signed = group is None or group.group()[:-1] not in _UNSIGNED_GROUPS
            column = _TableColumn(
                key=key, index=index, unit=(unit or "").strip(), title=title, is_signed=is_signed
            )
            if key not in found or (is_signed and not found[key].is_signed):
                found[key] = column
    return found


def _check_units(columns: _Columns, path: Path, line: int) -> None:
    for key, column in columns.items():
        known = UNITS_OF.get(key, ANGLES).keys() | _NO_UNITS
        if key not in _TEXTS and column.unit not in known:
            raise BadInputError(
                f"{path}, line {line}: the unit of {column.title.strip()!r} is not understood; "
                f"write one of {', '.join(sorted(known - _NO_UNITS))}"
            )


def _row_record(
    columns: _Columns, row: list[str], width: int, line: int, refused: list[RefusedText]
) -> Record:
    """The values of one row; what is of no known form goes to `refused`."""
    if any(cell.strip() for cell in row[width:]) or len(row) <= _last_needed(columns):
        why = f"{len(row)} cells under {width} titles (a comma within a number, or cut off?)"
        refused.append(RefusedText(line, "row", ",".join(row), why, is_position=True))
        return {}
    cells = {key: row[c.index] if c.index < len(row) else "" for key, c in columns.items()}
    cells |= _untitled_references(columns, row, cells)
    record: Record = {}
    for key, column in columns.items():
        try:
            record |= _cell_record(column, cells)
        except UnknownForm as error:
            is_position = key in ("latitude_deg", "longitude_deg")
            refused.append(
                RefusedText(line, column.title.strip(), cells[key], str(error), is_position)
            )
    if not isfinite(record.get("latitude_deg", nan) + record.get("longitude_deg", nan)):
        record |= {"latitude_deg": nan, "longitude_deg": nan}
    return record | _time_record(columns, cells, line, refused)


def _untitled_references(
    columns: _Columns, row: list[str], cells: Mapping[str, str]
) -> dict[str, str]:
    """Hemispheres beside their coordinate, in columns whose title is not understood."""
    taken = {column.index for column in columns.values()}
    found: dict[str, str] = {}
    for axis, sides in SIDES.items():
        at = columns[f"{axis}_deg"].index
        for index in (at - 1, at + 1):
            is_free = 0 <= index < len(row) and index not in taken
            if is_free and f"{axis}_ref" not in cells and row[index].strip().lower() in sides:
                found[f"{axis}_ref"] = row[index]
    return found


def _last_needed(columns: _Columns) -> int:
    """Place of the coordinate that stands last."""
    return max(columns[key].index for key in ("latitude_deg", "longitude_deg"))


def _cell_record(column: _TableColumn, cells: Mapping[str, str]) -> Record:
    key, text = column.key, cells[column.key]
    if key in ("latitude_deg", "longitude_deg"):
        axis = key.removesuffix("_deg")
        reference = cells.get(f"{axis}_ref", None if column.is_signed else "")
        return {key: parse_coordinate(text, axis, reference)}
    if key in _TEXTS or key == "times_s":
        return {}
    decimal_comma = "," in cells["latitude_deg"] + cells["longitude_deg"]
    units = UNITS_OF.get(key, ANGLES)
    value = parse_quantity(text, units, unit=column.unit, decimal_comma=decimal_comma)
    return {key: _signed_height(value, cells) if key == "altitude_m" else value}


def _signed_height(height_m: float, cells: Mapping[str, str]) -> float:
    side = cells.get("altitude_ref", "").strip().lower()
    if side not in _SIGNED_HEIGHTS | _UNSIGNED_HEIGHTS and not isnan(height_m):
        raise UnknownForm(f"{side!r} is no known side of the sea level")
    return -abs(height_m) if side in _SIGNED_HEIGHTS else height_m


def _time_record(
    columns: _Columns, cells: Mapping[str, str], line: int, refused: list[RefusedText]
) -> Record:
    """Seconds since 1970, or from any start, of the columns of times together."""
    record: Record = {}
    days_s: list[float] = []
    decimal_comma = "," in cells["latitude_deg"] + cells["longitude_deg"]
    for key in ("clock_s", "day", "times_s"):
        column, text = columns.get(key), cells.get(key, "")
        if column is None:
            continue
        try:
            found = _moment_record(column, text, decimal_comma=decimal_comma)
        except UnknownForm as error:
            refused.append(RefusedText(line, column.title.strip(), text, str(error), False))
            continue
        if "day_s" in found:
            days_s.append(found.pop("day_s"))
        if "of_day_s" in found and days_s:
            found["clock_s"] = found.pop("of_day_s") + days_s[0]
        record = found | record
    return record


def _moment_record(column: _TableColumn, text: str, *, decimal_comma: bool) -> Record:
    """One of ``clock_s`` (perhaps with ``utc``), ``day_s``, ``of_day_s`` and ``times_s``."""
    utc: Record = {"utc": 1.0} if "utc" in column.title.lower() else {}
    seconds, zoned = parse_stamp(text)
    if not isnan(seconds):
        return {"clock_s": seconds} | ({"utc": 1.0} if zoned else utc)
    if not isnan(of_day_s := parse_clock_time(text)):
        return {"of_day_s": of_day_s} | utc
    if not isnan(day_s := parse_date(text)):
        return {"day_s": day_s}
    value = parse_quantity(text, DURATIONS, unit=column.unit, decimal_comma=decimal_comma)
    if value >= _FIRST_POSIX_S:
        return {"clock_s": _posix_s(value), "utc": 1.0}
    if not isnan(value) and column.key != "times_s":
        raise UnknownForm("no known form of a date and time")
    return {} if isnan(value) else {"times_s": value}


def _posix_s(value: float) -> float:
    """Seconds since 1970 of a count of s, ms, us or ns, which no two of them can be.

    Raises:
        UnknownForm: It is a time of none of them between 1973 and 2096.
    """
    for unit in (1.0, 1e3, 1e6, 1e9):
        if _FIRST_POSIX_S <= value / unit < _LAST_POSIX_S:
            return value / unit
    raise UnknownForm("no time since 1970 in s, ms, us or ns")


def _raise_if_no_time(
    columns: _Columns,
    values: Mapping[str, FloatArray],
    path: Path,
    refused: Sequence[RefusedText],
) -> None:
    titles = {columns[key].title.strip() for key in ("clock_s", "day", "times_s") if key in columns}
    first = next((entry for entry in refused if entry.what in titles), None)
    known = [np.isfinite(values.get(key, np.nan)).any() for key in _MOMENTS]
    if first is not None and not any(known):
        raise BadInputError(
            f"{path}, {first}; write seconds, 12:34:56 or 2024-05-01 12:34:56, or photo names"
        )


def _count_on_past_midnight(values: dict[str, FloatArray]) -> None:
    """Makes times of day that have no date the table's ``times_s``."""
    of_day_s = values.pop("of_day_s", None)
    if of_day_s is None or np.isfinite(values.get("times_s", np.nan)).any():
        return
    known = np.isfinite(of_day_s)
    past = np.diff(of_day_s[known], prepend=of_day_s[known][:1]) < -DAY_S / 2
    of_day_s[known] += DAY_S * np.cumsum(past)
    values["times_s"] = of_day_s


def _choose_altitude(values: dict[str, FloatArray]) -> AltitudeDatum:
    """Makes the best altitude that the table has its ``altitude_m``."""
    for key, datum in ALTITUDES.items():
        if np.isfinite(values.get(key, np.nan)).any():
            values["altitude_m"] = values[key]
            return datum
    return AltitudeDatum.UNKNOWN
