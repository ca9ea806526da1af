"""Position and attitude of a vehicle and its camera over time, from its own records."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import Enum
from pathlib import Path
from typing import Any, Self

import numpy as np

from geometry.arrays import BoolArray, FloatArray, IntArray
from geometry.errors import BadInputError
from locate.telemetry.resample import interpolate

_ROUND = (
    "longitude_deg",
    "gimbal_yaw_deg",
    "gimbal_roll_deg",
    "vehicle_yaw_deg",
    "vehicle_roll_deg",
)
PERIOD_DEG = dict.fromkeys(_ROUND, 360.0)
COLUMNS = (
    "latitude_deg",
    "longitude_deg",
    "altitude_m",
    "height_m",
    "horizontal_sigma_m",
    "vertical_sigma_m",
    "speed_mps",
    "gimbal_yaw_deg",
    "gimbal_pitch_deg",
    "gimbal_roll_deg",
    "vehicle_yaw_deg",
    "vehicle_pitch_deg",
    "vehicle_roll_deg",
    "clock_s",
)
METRES_PER_DEGREE = 111_320.0
"""Of latitude."""
MAX_DECIMALS = 8
"""Of a degree; finer steps are not searched for."""
MAX_GAP_S = 2.0
"""Longest gap between records that is interpolated; chosen."""
GAP_SPACINGS, LONGEST_GAP_S = 3.0, 10.0
"""The same of a recorder with few records, in their usual spacings, and at most; chosen: between
records 10 s apart a camera that speeds up by 0.3 m/s^2 is 4 m from the straight line."""
HELD_ENDS_S = 0.25
"""Longest time beyond the first and the last record that these stand for; chosen."""
HELD_S = 1.0
"""A position repeated for longer is a hover; chosen."""


class AltitudeDatum(Enum):
    """What an altitude counts from; the value is the name used in files and messages."""

    ELLIPSOID = "ellipsoid"
    MEAN_SEA_LEVEL = "mean sea level"
    TAKEOFF = "takeoff"
    UNKNOWN = "unknown"


class Clock(Enum):
    """Which time of day a record states."""

    UTC = "UTC"
    LOCAL = "local"
    NONE = "none"


@dataclass(frozen=True, kw_only=True)
class TelemetryTrack:
    """N records of position and attitude; NaN where a record lacks a value.

    Angles are in degrees in the north-east-down sense: yaw clockwise from true north, pitch up
    positive (a camera that looks straight down has -90), roll to the right positive, turned in the
    order yaw, pitch, roll; yaw, roll and longitude lie in [-180, 180).

    Attributes:
        path: Where it was read, for messages.
        kind: The format it was in.
        latitude_deg: (N,) WGS84.
        longitude_deg: (N,) WGS84.
        altitude_m: (N,) above `altitude_datum`.
        altitude_datum: What the altitude counts from, by the file or the standard it follows.
        height_m: (N,) above the place of takeoff, mostly barometric.
        horizontal_sigma_m: (N,) along each horizontal axis, only where the file states it.
        vertical_sigma_m: (N,) only where the file states it.
        speed_mps: (N,) horizontal speed, only where the file states it.
        gimbal_yaw_deg: (N,) of the camera.
        gimbal_pitch_deg: (N,) of the camera.
        gimbal_roll_deg: (N,) of the camera.
        vehicle_yaw_deg: (N,) of the aircraft.
        vehicle_pitch_deg: (N,) of the aircraft.
        vehicle_roll_deg: (N,) of the aircraft.
        clock_s: (N,) s since 1970-01-01 00:00 on the clock named by `clock`.
        clock: UTC, the local time of the recorder, or none.
        times_s: (N,) s since the start of the recording (a video's own subtitles) or else since
            the first record, ascending; None for records of single photos.
        names: Name of the photo of each record; empty where records have times.
        warnings: What is wrong with the file without making it useless.
    """

    path: Path
    kind: str
    latitude_deg: FloatArray
    longitude_deg: FloatArray
    altitude_m: FloatArray
    altitude_datum: AltitudeDatum
    height_m: FloatArray
    horizontal_sigma_m: FloatArray
    vertical_sigma_m: FloatArray
    speed_mps: FloatArray
    gimbal_yaw_deg: FloatArray
    gimbal_pitch_deg: FloatArray
    gimbal_roll_deg: FloatArray
    vehicle_yaw_deg: FloatArray
    vehicle_pitch_deg: FloatArray
    vehicle_roll_deg: FloatArray
    clock_s: FloatArray
    clock: Clock = Clock.NONE
    times_s: FloatArray | None = None
    names: tuple[str, ...] = ()
    warnings: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        n = len(self.latitude_deg)
        shapes = {name: getattr(self, name).shape for name in COLUMNS}
        if self.times_s is not None:
            shapes["times_s"] = self.times_s.shape
        for name, shape in shapes.items():
            if shape != (n,):
                raise ValueError(f"{name}.shape={shape}, expected {(n,)}")
        if len(self.names) not in (0, n):
            raise ValueError(f"{len(self.names)} names, expected 0 or {n}")

    def __len__(self) -> int:
        return len(self.latitude_deg)

    @property
    def has_position(self) -> BoolArray:
        """(N,) records with a position; the altitude may still be missing."""
        return np.isfinite(self.latitude_deg)

    @property
    def usual_gap_s(self) -> float:
        """Gap between positions that belongs to this recorder; phones write one in some seconds."""
        if self.times_s is None or self.has_position.sum() < 2:
            return MAX_GAP_S
        spacing_s = float(np.median(np.diff(self.times_s[self.has_position])))
        return float(np.clip(GAP_SPACINGS * spacing_s, MAX_GAP_S, LONGEST_GAP_S))

    @property
    def step_m(self) -> float:
        """The step that positions are rounded to, in m; 11 m for files with four decimals.

        A lower bound of what a position can be trusted to: rounding alone has a standard deviation
        of ``step_m / sqrt(12)``, stated nowhere in the file.
        """
        known = np.concatenate([self.latitude_deg, self.longitude_deg])
        known = known[np.isfinite(known)]
        decimals = next(
            (
                d
                for d in range(MAX_DECIMALS)
                if np.abs(known - known.round(d)).max(initial=0) < 1e-9
            ),
            MAX_DECIMALS,
        )
        return METRES_PER_DEGREE * 10.0**-decimals

    def take(self, rows: Sequence[int] | IntArray | BoolArray) -> Self:
        """The records of the given rows only."""
        chosen = np.arange(len(self))[np.asarray(rows)]
        return replace(
            self,
            **{name: getattr(self, name)[chosen] for name in COLUMNS},
            times_s=None if self.times_s is None else self.times_s[chosen],
            names=tuple(self.names[i] for i in chosen) if self.names else (),
        )

    def without_repeats(self) -> Self:
        """Only the records at which the position changed.

        A receiver of 5 Hz in a file of 30 Hz repeats each position six times: a staircase that
        interpolation would follow. A position held for over a second is a hover: its last
        repetition stays too.
        """
        times_s = self._required_times()
        moved = np.ones(len(self), dtype=bool)
        for name in ("latitude_deg", "longitude_deg"):
            moved[1:] &= np.diff(getattr(self, name)) == 0
        moved[1:] = ~moved[1:]
        first = np.flatnonzero(moved)
        last = np.append(first[1:], len(self)) - 1
        hovered = times_s[last] - times_s[first] > HELD_S
        return self.take(np.union1d(first, last[hovered]))

    def at(self, times_s: FloatArray, *, max_gap_s: float = MAX_GAP_S) -> Self:
        """The track at other times, interpolated linearly (angles the short way round).

        Times up to a record's spacing before the first or after the last, at most `HELD_ENDS_S`,
        have the values of these: stamps are rounded, and a value holds until the next one.

        Args:
            times_s: (M,) on the clock of this track's `times_s`.
            max_gap_s: Across a longer gap between records, and outside of them, values are NaN.

        Raises:
            BadInputError: The records have names and no times.
        """
        stamps_s, wanted_s = self._required_times(), np.asarray(times_s, dtype=float)
        moments_s = _pull_to_ends(wanted_s, stamps_s)
        columns: dict[str, Any] = {
            name: interpolate(
                moments_s, stamps_s, getattr(self, name), max_gap_s, period=PERIOD_DEG.get(name)
            )
            for name in COLUMNS
        }
        return replace(self, **columns, times_s=wanted_s, names=())

    def rows_of(self, names: Sequence[str]) -> IntArray:
        """(M,) row of each photo, -1 where it has none.

        By file name, then by file name without its suffix. Records that have only a number, as in
        a .mrk file, match the last number in the photo's name (``100_0021_0002.JPG`` is 2).
        """
        tables = [
            {key(name): row for row, name in reversed(list(enumerate(self.names)))}
            for key in (file_name, _file_stem)
        ]
        if self.names and all(name.isdecimal() for name in self.names):
            numbers = {str(int(name)): row for row, name in enumerate(self.names)}
            return np.array([numbers.get(_last_number(n), -1) for n in names], dtype=np.int64)
        by_name, by_stem = tables
        rows = [by_name.get(file_name(n), by_stem.get(_file_stem(n), -1)) for n in names]
        return np.array(rows, dtype=np.int64)

    def named(self, name: str) -> Self:
        """The one record of a photo.

        Raises:
            BadInputError: There is none.
        """
        (row,) = self.rows_of([name])
        if row < 0:
            raise BadInputError(f"{self.path}: holds no record of {name}")
        return self.take([int(row)])

    def _required_times(self) -> FloatArray:
        if self.times_s is None:
            raise BadInputError(
                f"{self.path}: its records belong to single photos and have no times; "
                "use it with the folder of these photos, not with a video"
            )
        return self.times_s


def _pull_to_ends(wanted_s: FloatArray, stamps_s: FloatArray) -> FloatArray:
    """The times, those just outside of the records at the first or the last of them."""
    if len(stamps_s) < 2:
        return wanted_s
    held_s = min(HELD_ENDS_S, float(np.median(np.diff(stamps_s))))
    pulled_s = np.clip(wanted_s, stamps_s[0], stamps_s[-1])
    return np.where(np.abs(pulled_s - wanted_s) <= held_s, pulled_s, wanted_s)


def file_name(name: str) -> str:
    """The name of a photo without its folders, in lower case."""
    return name.replace("\\", "/").rsplit("/", 1)[-1].lower()


def _file_stem(name: str) -> str:
    return Path(file_name(name)).stem


def _last_number(name: str) -> str:
    digits = "".join(c if c.isdecimal() else " " for c in _file_stem(name)).split()
    return str(int(digits[-1])) if digits and len(digits[-1]) < 20 else ""
