"""The ``GPS(..)`` of drones' subtitles: which of its numbers is the latitude.

Known forms, each of one maker's files:

- ``GPS(longitude,latitude,satellites)``: DJI until the Mini 2; the count is a whole number over 0.
- ``GPS(latitude,longitude,altitudeM)``: Matrice 300; a capital M.
- ``GPS(latitude,longitude,altitude) BAROMETER(height)``: Avata 2; recognised by the brackets.
- ``GPS(E: longitude, N: latitude, altitude m)``: Autel; the letters say which is which.
"""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum
from math import nan

from locate.telemetry.assemble import Record
from locate.telemetry.cells import BLANK, UnknownForm, parse_coordinate, parse_quantity

_WORDS = re.compile(r"\bgps\s?\(([^()\n]{0,120})(\)?)", re.IGNORECASE)
_BRACKETED_BAROMETER = re.compile(r"\bbarometer\s?\(", re.IGNORECASE)
_DEGREES = re.compile(r"[-+]?\d{1,3}(?:\.\d{1,12})?")
_LETTER = re.compile(r"[nsew]\s?:?\s?", re.IGNORECASE)
_SATELLITES = re.compile(r"[1-9]\d?")
_HEIGHT = re.compile(r"[-+]?\d{1,6}(?:\.\d{1,12})?")
_HEIGHT_M = re.compile(r"([-+]?\d{1,6}(?:\.\d{1,12})?) ?M")
_METRES = {"m": 1.0}


class TupleOrder(Enum):
    """What stands first in the tuple; the value is for messages."""

    LATITUDE = "latitude"
    LONGITUDE = "longitude"
    LETTERED = "lettered"
    UNKNOWN = "unknown"


@dataclass(frozen=True)
class GpsTuple:
    """One ``GPS(..)`` of a file.

    Attributes:
        text: As it stands there.
        order: By its form alone.
        first: Degrees; NaN without fix. The latitude of a lettered one.
        second: Degrees. The longitude of a lettered one.
        altitude_m: NaN where the third number is none.
    """

    text: str
    order: TupleOrder
    first: float
    second: float
    altitude_m: float


def find_gps_tuple(body: str) -> GpsTuple | None:
    """The ``GPS(..)`` of a subtitle, if it has one.

    Raises:
        UnknownForm: It has one, of no known form, or several.
    """
    found = list(_WORDS.finditer(body))
    if not found:
        return None
    text = found[0].group(0)
    parts = [part.strip() for part in found[0].group(1).split(",")]
    if len(found) > 1 or len(parts) != 3 or not found[0].group(2):
        raise UnknownForm("not one GPS(..) of three values")
    first, second, third = parts
    if {first.lower(), second.lower()} & (BLANK - {""}):
        return GpsTuple(text, TupleOrder.LETTERED, nan, nan, nan)
    if _LETTER.match(first):
        return _read_lettered(text, first, second, third)
    if not _DEGREES.fullmatch(first) or not _DEGREES.fullmatch(second):
        raise UnknownForm("no known form of a coordinate")
    order, altitude_m = _order_by_third(third, bool(_BRACKETED_BAROMETER.search(body)))
    return GpsTuple(text, order, float(first), float(second), altitude_m)


def _read_lettered(text: str, first: str, second: str, third: str) -> GpsTuple:
    if not _LETTER.match(second):
        raise UnknownForm("a letter before one of its coordinates only")
    altitude_m = parse_quantity(third, _METRES)
    if first[0].lower() in "ew":
        first, second = second, first
    latitude_deg = parse_coordinate(first, "latitude")
    longitude_deg = parse_coordinate(second, "longitude")
    return GpsTuple(text, TupleOrder.LETTERED, latitude_deg, longitude_deg, altitude_m)


def _order_by_third(third: str, has_bracketed_barometer: bool) -> tuple[TupleOrder, float]:
    if match := _HEIGHT_M.fullmatch(third):
        return TupleOrder.LATITUDE, float(match[1])
    if has_bracketed_barometer and _HEIGHT.fullmatch(third):
        return TupleOrder.LATITUDE, float(third)
    if _SATELLITES.fullmatch(third):
        return TupleOrder.LONGITUDE, nan
    if _HEIGHT.fullmatch(third) or re.fullmatch(rf"{_HEIGHT.pattern} ?m", third):
        return TupleOrder.UNKNOWN, nan
    raise UnknownForm("no known form of the third value")


def decide_order(tuples: Sequence[GpsTuple]) -> TupleOrder:
    """The one order of all tuples of a file that have no letters.

    By their form; where that is not known, by a number over 90, which is no latitude.

    Raises:
        UnknownForm: Forms and numbers contradict each other, or neither decides.
    """
    plain = [entry for entry in tuples if entry.order is not TupleOrder.LETTERED]
    said = {entry.order for entry in plain} - {TupleOrder.UNKNOWN}
    must = set()
    if any(abs(entry.first) > 90 for entry in plain):
        must.add(TupleOrder.LONGITUDE)
    if any(abs(entry.second) > 90 for entry in plain):
        must.add(TupleOrder.LATITUDE)
    if not plain:
        return TupleOrder.LETTERED
    if len(said | must) > 1:
        raise UnknownForm("its form and its numbers contradict each other on what is the latitude")
    if not said | must:
        raise UnknownForm("whether the latitude stands first or second cannot be known")
    return next(iter(said | must))


def tuple_record(entry: GpsTuple, order: TupleOrder) -> Record:
    """The position in a tuple.

    Args:
        entry: The tuple.
        order: That of its file.
    """
    latitude_deg, longitude_deg = entry.first, entry.second
    if entry.order is not TupleOrder.LETTERED and order is TupleOrder.LONGITUDE:
        latitude_deg, longitude_deg = longitude_deg, latitude_deg
    record: Record = {"latitude_deg": latitude_deg, "longitude_deg": longitude_deg}
    if entry.altitude_m == entry.altitude_m:
        record["altitude_m"] = entry.altitude_m
    return record
