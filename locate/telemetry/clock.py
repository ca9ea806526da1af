"""Times of day from the numbers and texts that files hold."""

import re
from datetime import UTC, datetime
from math import nan

GPS_EPOCH_S = 315_964_800.0  # 1980-01-06
GPS_AHEAD_OF_UTC_S = 18.0  # since 2017-01-01
WEEK_S = 604_800.0
DATE_TIME = re.compile(
    r"(\d{4})[.:/-](\d{1,2})[.:/-](\d{1,2})[T ]\s?(\d{1,2}):(\d{2}):(\d{2})"
    r"(?:[.,](\d{1,9}))?(?:,(\d{3}))?(Z|[+-]\d{2}:?\d{2})?"
)


def posix_s(year: int, month: int, day: int, hour: int, minute: int, second: float) -> float:
    """Seconds since 1970 of a UTC time; NaN for a date that does not exist."""
    try:
        whole = datetime(year, month, day, hour, minute, tzinfo=UTC)
    except (ValueError, OverflowError):
        return nan
    return whole.timestamp() + second if 0 <= second < 61 else nan


def parse_date_time(text: str) -> tuple[float, bool]:
    """Seconds since 1970 of the first date and time in a text, NaN without, and whether it is UTC.

    Takes ISO 8601, EXIF's colons and DJI's ``2020-08-12 08:55:21,745,078``. Without a zone the
    seconds count on the writer's own clock.
    """
    found = DATE_TIME.search(text)
    if not found:
        return nan, False
    *date, millis, micros, zone = found.groups()
    year, month, day, hour, minute, second = (int(part) for part in date)
    fraction = float(f"0.{millis or 0}{micros or ''}")
    seconds = posix_s(year, month, day, hour, minute, second + fraction)
    return seconds - _offset_s(zone), zone is not None


def gps_to_posix_s(week: float, seconds_of_week: float) -> float:
    """UTC of a GPS week and time of week, with the leap seconds in force since 2017."""
    return GPS_EPOCH_S + week * WEEK_S + seconds_of_week - GPS_AHEAD_OF_UTC_S


def _offset_s(zone: str | None) -> float:
    if zone is None or zone == "Z":
        return 0.0
    hours, minutes = int(zone[1:3]), int(zone[-2:])
    return (1 if zone[0] == "+" else -1) * (hours * 3600.0 + minutes * 60.0)
