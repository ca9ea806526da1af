"""The numbers, coordinates and times that a cell of text may hold.

A cell matches one known form from its first character to its last, or it is refused: nothing is
taken out of the middle of what is not understood.
"""

import re
from collections.abc import Mapping
from math import isnan, nan

from locate.telemetry.clock import DATE_TIME, parse_date_time, posix_s

BLANK = {"", "-", "--", "n/a", "na", "nan", "null", "none", "undef"}
"""What writers put where they know nothing, in lower case."""
SIDES = {
    "latitude": {"n": 1.0, "s": -1.0, "north": 1.0, "south": -1.0},
    "longitude": {"e": 1.0, "w": -1.0, "east": 1.0, "west": -1.0},
}
"""Signs of the hemispheres of each axis."""
SIZES_DEG = {"latitude": 90.0, "longitude": 360.0}
"""The largest coordinates that are read; some count longitude from 0 to 360."""
LENGTHS = {"m": 1.0, "meter": 1.0, "meters": 1.0, "metre": 1.0, "metres": 1.0}
LENGTHS |= {"ft": 0.3048, "foot": 0.3048, "feet": 0.3048, "km": 1000.0}
SPEEDS = {"m/s": 1.0, "mps": 1.0, "km/h": 1 / 3.6, "kmh": 1 / 3.6, "kph": 1 / 3.6}
SPEEDS |= {"mph": 0.44704, "kn": 0.514444, "knot": 0.514444, "knots": 0.514444}
ANGLES = {"deg": 1.0, "degree": 1.0, "degrees": 1.0, "°": 1.0, "º": 1.0}
DURATIONS = {"s": 1.0, "sec": 1.0, "second": 1.0, "seconds": 1.0}
DURATIONS |= {"ms": 1e-3, "millisecond": 1e-3, "milliseconds": 1e-3}
DURATIONS |= {"us": 1e-6, "microsecond": 1e-6, "microseconds": 1e-6}
DAY_S = 86_400.0
_DEGREES, _MINUTES, _SECONDS = r"\s*(?:°|º|deg|d)\s*", r"\s*(?:'|′|’)\s*", r"\s*(?:\"|″|”|'')"  # noqa: RUF001
_PARTS = (
    re.compile(rf"(\d{{1,3}}(?:[.,]\d{{0,20}})?(?:e[-+]?\d{{1,3}})?)(?:{_DEGREES})?"),
    re.compile(rf"(\d{{1,3}}){_DEGREES}(\d{{1,2}}(?:[.,]\d{{1,15}})?){_MINUTES}"),
    re.compile(
        rf"(\d{{1,3}}){_DEGREES}(\d{{1,2}}){_MINUTES}(\d{{1,2}}(?:[.,]\d{{1,15}})?){_SECONDS}"
    ),
    re.compile(r"(\d{1,3}) +(\d{1,2}(?:[.,]\d{1,15})?)"),
    re.compile(r"(\d{1,3})[ :]+(\d{1,2})[ :]+(\d{1,2}(?:[.,]\d{1,15})?)"),
)
"""Degrees; degrees and minutes; degrees, minutes and seconds; the same between spaces or colons."""
_SIDE = r"(north|south|east|west|[nsew])"
_AROUND = re.compile(
    rf"(?:{_SIDE}\s{{0,3}}:?\s{{0,3}})?([-+]?)(.*?)(?:\s{{0,3}}{_SIDE})?", re.DOTALL
)
_QUANTITY = re.compile(
    r"([-+]?\d{1,19}(?:[.,]\d{0,20})?(?:e[-+]?\d{1,3})?)\s{0,3}([a-z°º/]{0,12})"
    r"(?: (above|below) sea level)?"
)
_GROUPED = re.compile(r"[-+]?\d{1,3}(,\d{3})+")
_CLOCK_TIME = re.compile(r"(\d{1,2}):(\d{2}):(\d{2}(?:[.,]\d{1,9})?)(?: ?([ap])\.?m\.?)?")
_DATES = (
    re.compile(r"(?P<year>\d{4})([-/.:])(?P<month>\d{1,2})\2(?P<day>\d{1,2})"),
    re.compile(r"(?P<day>\d{1,2})\.(?P<month>\d{1,2})\.(?P<year>\d{4})"),
)
_LONGEST = 80
"""Longer cells hold no number."""


class UnknownForm(ValueError):  # noqa: N818 - a verdict on a cell, turned into a message
    """A cell of no known form; the message says what is wrong with it."""


def parse_coordinate(text: str, axis: str, reference: str | None = None) -> float:
    """Degrees of a latitude or longitude; NaN for a cell that says it holds nothing.

    Decimal degrees, or degrees with minutes and seconds, which need a sign or hemisphere. All
    that is said of the sign (a minus, a letter, the column of references) must agree.

    Args:
        text: The cell.
        axis: ``latitude`` or ``longitude``.
        reference: The hemisphere in a column of its own, where the table has one.

    Raises:
        UnknownForm: It is anything else.
    """
    cell = text.strip().lower()
    if cell in BLANK:
        return nan
    if len(cell) > _LONGEST:
        raise UnknownForm("too long for a coordinate")
    around = _AROUND.fullmatch(cell)
    before, sign, inside, after = around.groups() if around else (None, "", cell, None)
    signs = {_side_sign(side, axis) for side in (before, after) if side}
    if sign:
        signs.add(1.0 if sign == "+" else -1.0)
    if reference is not None:
        signs |= _reference_signs(reference, axis, known=bool(signs))
    if len(signs) > 1:
        raise UnknownForm("its sign and its hemisphere contradict each other")
    parts = _degree_parts(inside)
    if not signs and len(parts) > 1:
        raise UnknownForm("neither a sign nor a hemisphere")
    size: float = sum(part / 60.0**i for i, part in enumerate(parts))
    if size > SIZES_DEG[axis] or (size > 180.0 and signs):
        raise UnknownForm(f"beyond the largest {axis}")
    return size * next(iter(signs), 1.0)


def reference_sign(reference: str, axis: str) -> float:
    """1 for a hemisphere of north or east, -1 for one of south or west.

    Raises:
        UnknownForm: It is none of this axis, or missing.
    """
    (sign,) = _reference_signs(reference, axis, known=False)
    return sign


def _side_sign(side: str, axis: str) -> float:
    if side not in SIDES[axis]:
        raise UnknownForm(f"{side.upper()} is no side of a {axis}")
    return SIDES[axis][side]


def _reference_signs(reference: str, axis: str, *, known: bool) -> set[float]:
    side = reference.strip().lower()
    if side in BLANK:
        if known:
            return set()
        raise UnknownForm("its hemisphere is not given")
    return {_side_sign(side, axis)}


def _degree_parts(text: str) -> list[float]:
    match = next((found for form in _PARTS if (found := form.fullmatch(text))), None)
    if match is None:
        raise UnknownForm("no known form of a coordinate")
    parts = [float(part.replace(",", ".")) for part in match.groups()]
    if any(part >= 60 for part in parts[1:2]) or any(part > 60 for part in parts[2:]):
        raise UnknownForm("60 minutes or seconds or more")
    return parts


def parse_quantity(
    text: str, units: Mapping[str, float], *, unit: str = "", decimal_comma: bool = False
) -> float:
    """A number with or without its unit; NaN for a cell that says it holds nothing.

    Args:
        text: The cell.
        units: Size of each unit that it may be in.
        unit: The unit that the title of the column states.
        decimal_comma: Whether other cells of the row show that a comma begins the decimals.

    Raises:
        UnknownForm: It is anything else, or a comma whose meaning is not known.
    """
    cell = text.strip().lower()
    if cell in BLANK:
        return nan
    match = _QUANTITY.fullmatch(cell) if len(cell) <= _LONGEST else None
    if match is None:
        raise UnknownForm("no known form of a number")
    number, own_unit, sea = match.groups()
    if "," in number and not decimal_comma:
        grouped = _GROUPED.fullmatch(number)
        raise UnknownForm("thousands or decimals?" if grouped else "a decimal comma beside points")
    if own_unit and (own_unit not in units or (unit and units[own_unit] != units.get(unit))):
        raise UnknownForm(f"the unit {own_unit} is not understood here")
    value = float(number.replace(",", ".")) * units.get(own_unit or unit, 1.0)
    return -abs(value) if sea == "below" else value


def parse_clock_time(text: str) -> float:
    """Seconds since midnight of ``HH:MM:SS`` with or without decimals and am or pm, else NaN."""
    match = _CLOCK_TIME.fullmatch(text.strip().lower())
    if match is None:
        return nan
    hour, minute, second = int(match[1]), int(match[2]), float(match[3].replace(",", "."))
    if match[4]:
        hour = hour % 12 + (12 if match[4] == "p" else 0) if 1 <= hour <= 12 else 99
    return hour * 3600 + minute * 60 + second if hour < 24 and minute < 60 > second else nan


def parse_date(text: str) -> float:
    """Seconds since 1970 of midnight of a day, year first or ``1.5.2024``, else NaN."""
    match = next((found for form in _DATES if (found := form.fullmatch(text.strip()))), None)
    if match is None:
        return nan
    return posix_s(int(match["year"]), int(match["month"]), int(match["day"]), 0, 0, 0)


def parse_stamp(text: str) -> tuple[float, bool]:
    """Seconds since 1970 of a cell that is a date and time, else NaN; and whether it is UTC."""
    cell = text.strip()
    bare = cell.removesuffix("UTC").removesuffix("GMT").strip()
    if not DATE_TIME.fullmatch(bare):
        return nan, False
    seconds, zoned = parse_date_time(bare)
    return seconds, not isnan(seconds) and (zoned or bare != cell)
