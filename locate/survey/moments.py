"""When a flight was: the hour of its day and the season, without any table of time zones."""

from datetime import UTC, datetime, timedelta
from pathlib import Path

import numpy as np

from geometry.errors import BadInputError
from locate.survey.model import FlightMoment
from locate.telemetry import read_telemetry
from locate.telemetry.track import Clock, TelemetryTrack

DEGREES_PER_HOUR = 15.0
"""Of longitude, by which solar time shifts."""
HOURS_PER_BIN = 3
"""Width of a part of the day; chosen."""
SEASONS = ("winter", "spring", "summer", "autumn")
EPOCH = datetime(1970, 1, 1, tzinfo=UTC)
UNKNOWN = "time unknown"


def moment_of(telemetry: tuple[Path, ...]) -> FlightMoment | None:
    """When a recording was made: by the first file that states a time."""
    for path in telemetry:
        try:
            track = read_telemetry(path)
        except BadInputError:
            continue
        found = moment_of_track(track)
        if found is not None:
            return found
    return None


def moment_of_track(track: TelemetryTrack) -> FlightMoment | None:
    """The middle of a track.

    Where the clock is UTC, the hour is mean solar time: UTC plus an hour for every 15 degrees of
    longitude, within a quarter of an hour of where the sun stands. Where only the recorder's own
    time is known, it is taken as it is.
    """
    clocks_s = track.clock_s[np.isfinite(track.clock_s)]
    longitudes_deg = track.longitude_deg[np.isfinite(track.longitude_deg)]
    if track.clock is Clock.NONE or not len(clocks_s):
        return None
    clock_s = float(np.median(clocks_s))
    utc = track.clock is Clock.UTC and len(longitudes_deg) > 0
    ahead_h = float(np.median(longitudes_deg)) / DEGREES_PER_HOUR if utc else 0.0
    local = EPOCH + timedelta(seconds=clock_s, hours=ahead_h)
    return FlightMoment(
        clock_s=clock_s,
        hour=local.hour + local.minute / 60 + local.second / 3600,
        day_of_year=local.timetuple().tm_yday,
        basis="UTC" if track.clock is Clock.UTC else "recorder",
    )


def bin_of(moment: FlightMoment | None, lat_deg: float) -> str:
    """Season (meteorological, of the hemisphere) and part of the day: ``"summer, 12-15 h"``."""
    if moment is None:
        return UNKNOWN
    first = int(moment.hour) // HOURS_PER_BIN * HOURS_PER_BIN
    return f"{season_of(moment, lat_deg)}, {first:02d}-{first + HOURS_PER_BIN:02d} h"


def season_of(moment: FlightMoment, lat_deg: float) -> str:
    """December to February are winter in the north, summer in the south."""
    month = (EPOCH.replace(year=2001) + timedelta(days=min(moment.day_of_year, 365) - 1)).month
    half_a_year = 0 if lat_deg >= 0 else 2
    return SEASONS[(month % 12 // 3 + half_a_year) % 4]


def bin_order(label: str) -> tuple[int, str]:
    """Sorts labels by season, then hour; the unknown comes last."""
    season = label.split(",", maxsplit=1)[0]
    return (SEASONS.index(season) if season in SEASONS else len(SEASONS), label)
