"""Photos on the clock of a log that was kept beside them, by the times they were taken."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from geometry.arrays import FloatArray
from geometry.errors import BadInputError
from locate.telemetry.photos import read_photo_clocks
from locate.telemetry.track import Clock, TelemetryTrack

ZONES_H = tuple(range(-12, 15))
"""Whole hours that a local time may be ahead of UTC."""


@dataclass(frozen=True, kw_only=True)
class PhotoMoments:
    """When photos were taken.

    Attributes:
        times_s: (N,) on the clock of the log's `times_s`; NaN where a photo states no time.
        notes: How the clocks were set against each other.
    """

    times_s: FloatArray
    notes: tuple[str, ...]


def moments_of_photos(
    folder: Path, names: Sequence[str], track: TelemetryTrack, offset_s: float | None = None
) -> PhotoMoments:
    """When photos were taken, on the clock of a log.

    A photo's time with a zone, or of its GPS, is UTC. A local one is tried in all whole hours: the
    one zone in which all photos were taken during the log is theirs.

    Args:
        folder: The photos.
        names: N of them.
        track: The log, with times of day.
        offset_s: Its time minus that of the photos, where it is known.

    Raises:
        BadInputError: The photos or the log state no time of day, or no zone fits, or several.
    """
    taken = read_photo_clocks(folder, names)
    known = np.isfinite(track.clock_s)
    if track.times_s is None or not known.any():
        raise BadInputError(f"{track.path}: its records have no time of day, and photos need one")
    if not np.isfinite(taken.clock_s).any():
        raise BadInputError(f"{folder}: its photos state no time at which they were taken")
    start_s = float(np.median((track.clock_s - track.times_s)[known]))
    times_s = taken.clock_s - start_s
    label = f"{track.path.name}: its positions were given to the photos by their times"
    if offset_s is not None:
        return PhotoMoments(times_s=times_s + offset_s, notes=(f"{label}.",))
    if taken.clock is track.clock:
        return PhotoMoments(times_s=times_s, notes=(f"{label} ({track.clock.value}).",))
    if taken.clock is Clock.LOCAL and track.clock is Clock.UTC:
        zones_h = [zone for zone in ZONES_H if _is_during(times_s - zone * 3600, track.times_s)]
        if len(zones_h) == 1:
            note = f"{label}, taken as local time of UTC{zones_h[0]:+d}."
            return PhotoMoments(times_s=times_s - zones_h[0] * 3600, notes=(note,))
        fitting = " and ".join(f"UTC{zone:+d}" for zone in zones_h) or "no zone"
    else:
        fitting = "no zone"
    raise BadInputError(
        f"{track.path}: the photos state a {taken.clock.value} time, and {fitting} would put all "
        "of them into the log; give --telemetry-offset, seconds of the log minus the photos'"
    )


def _is_during(times_s: FloatArray, log_s: FloatArray) -> bool:
    known = times_s[np.isfinite(times_s)]
    return bool((known >= log_s[0]).all() and (known <= log_s[-1]).all())
