"""From the records of a parser to a track: impossible values become NaN, time runs forward."""

from array import array
from collections.abc import Iterable, Mapping, Sequence
from itertools import repeat
from math import nan
from pathlib import Path
from typing import TypeAlias

import numpy as np

from geometry.arrays import BoolArray, FloatArray
from geometry.errors import BadInputError
from locate.telemetry.plausible import leave_out_namesakes, leave_out_strays
from locate.telemetry.resample import wrap_angles
from locate.telemetry.track import COLUMNS, PERIOD_DEG, AltitudeDatum, Clock, TelemetryTrack

Record: TypeAlias = dict[str, float]
"""Values by the name of the track's column, or ``times_s``."""

LIMITS = {
    "latitude_deg": (-90.0, 90.0),
    "longitude_deg": (-180.0, 360.0),
    "altitude_m": (-1_000.0, 100_000.0),
    "height_m": (-10_000.0, 100_000.0),
    "horizontal_sigma_m": (1e-6, 1e5),
    "vertical_sigma_m": (1e-6, 1e5),
    "speed_mps": (0.0, 1e4),
    "clock_s": (0.0, 4e9),
    "times_s": (-1e10, 1e10),
}
ANGLE_LIMITS = (-360.0, 360.0)
"""Of all angles that have no entry above."""


class ColumnStore:
    """Records gathered as columns, at eight bytes a value."""

    def __init__(self) -> None:
        self._columns: dict[str, array[float]] = {}
        self._count = 0

    def add(self, record: Mapping[str, float]) -> None:
        """Appends one record."""
        for key, value in record.items():
            column = self._columns.setdefault(key, array("d"))
            column.extend(repeat(nan, self._count - len(column)))
            column.append(value)
        self._count += 1

    def arrays(self) -> dict[str, FloatArray]:
        """(N,) arrays; NaN where a record lacked the key."""
        for column in self._columns.values():
            column.extend(repeat(nan, self._count - len(column)))
        return {key: np.array(column, dtype=float) for key, column in self._columns.items()}


def columns_of(records: Iterable[Mapping[str, float]]) -> dict[str, FloatArray]:
    """(N,) arrays of records; NaN where a record lacks the key."""
    store = ColumnStore()
    for record in records:
        store.add(record)
    return store.arrays()


def track_from_columns(
    path: Path,
    kind: str,
    columns: Mapping[str, FloatArray],
    *,
    datum: AltitudeDatum = AltitudeDatum.UNKNOWN,
    clock: Clock = Clock.NONE,
    names: Sequence[str] | None = None,
    warnings: Sequence[str] = (),
) -> TelemetryTrack:
    """Checks columns and makes a track of them.

    Values that cannot be (latitude 999, the null island of a receiver without fix) become NaN;
    records that hold nothing go; so do positions that no vehicle gets to from their neighbours.
    Where there are no `names` the records are put in the order of their ``times_s``, or of
    ``clock_s`` counted from the first.

    Args:
        path: The file.
        kind: Its format, for people.
        columns: (N,) arrays by the name of the track's column, or ``times_s``.
        datum: Of ``altitude_m``; without any altitude the height above takeoff takes its place.
        clock: Of ``clock_s``.
        names: Photo of each record.
        warnings: What the parser left out.

    Raises:
        BadInputError: No record has the position or attitude of the camera, or the frame that a
            record belongs to is not stated.
    """
    n = max((len(values) for values in columns.values()), default=0)
    clean = {key: _clean_column(key, columns.get(key), n) for key in (*COLUMNS, "times_s")}
    nowhere = _blank_null_island(clean)
    if not np.nan_to_num(clean["altitude_m"]).any():  # some write zero where they know nothing
        clean["altitude_m"] = clean["height_m"].copy()
        known = np.isfinite(clean["height_m"]).any()
        datum = AltitudeDatum.TAKEOFF if known else AltitudeDatum.UNKNOWN
    kept = _holds_a_value(clean)
    if not kept.any():
        raise BadInputError(
            f"{path}: none of {n} records of this {kind} file has a camera position "
            "(was the receiver off or without fix?)"
        )
    times_s: FloatArray | None = None
    disorder: list[str] = []
    if names is None:
        times_s, kept, disorder = _sort_by_time(path, kind, clean, kept)
    rows = np.flatnonzero(kept)
    if times_s is not None:
        rows = rows[np.argsort(times_s[rows], kind="stable")]
        times_s = times_s[rows]
    notes = [*disorder, *warnings, *_missing_notes(path, int(nowhere[rows].sum()), len(rows), n)]
    taken = {key: clean[key][rows] for key in COLUMNS}
    photos = () if names is None else tuple(names[int(i)] for i in rows)
    latitude_deg, longitude_deg = taken["latitude_deg"], taken["longitude_deg"]
    notes += leave_out_namesakes(path, latitude_deg, longitude_deg, photos)
    notes += leave_out_strays(path, latitude_deg, longitude_deg, times_s, photos)
    if not np.isfinite(taken["clock_s"]).any():
        clock = Clock.NONE
    return TelemetryTrack(
        path=path,
        kind=kind,
        **taken,
        altitude_datum=datum,
        clock=clock,
        times_s=times_s,
        names=photos,
        warnings=tuple(notes),
    )


def _blank_null_island(columns: dict[str, FloatArray]) -> BoolArray:
    """(N,) which records have no position; those at 0, 0 lose it, in place."""
    latitude_deg, longitude_deg = columns["latitude_deg"], columns["longitude_deg"]
    nowhere = ~np.isfinite(latitude_deg + longitude_deg)
    nowhere |= (latitude_deg == 0) & (longitude_deg == 0)
    latitude_deg[nowhere] = longitude_deg[nowhere] = np.nan
    return nowhere


def _missing_notes(path: Path, lost: int, kept: int, total: int) -> list[str]:
    """Notes on the records without a position among those kept, and on those left out."""
    notes = []
    if lost:
        notes.append(f"{path.name}: {lost} of {kept} records have no position")
    if kept < total:
        notes.append(
            f"{path.name}: {total - kept} of {total} records were left out: "
            "nothing in them, no time, or the time of another"
        )
    return notes


def _clean_column(key: str, values: FloatArray | None, n: int) -> FloatArray:
    if values is None:
        return np.full(n, np.nan)
    low, high = LIMITS.get(key, ANGLE_LIMITS)
    clean = np.array(values, dtype=float)
    clean[~((clean >= low) & (clean <= high))] = np.nan
    return wrap_angles(clean) if key in PERIOD_DEG else clean


def _holds_a_value(clean: Mapping[str, FloatArray]) -> BoolArray:
    useful = ("latitude_deg", "altitude_m", "height_m", "gimbal_pitch_deg", "vehicle_pitch_deg")
    return np.asarray(np.isfinite([clean[key] for key in useful]).any(axis=0))


def _sort_by_time(
    path: Path, kind: str, clean: Mapping[str, FloatArray], kept: BoolArray
) -> tuple[FloatArray, BoolArray, list[str]]:
    times_s = clean["times_s"]
    if not np.isfinite(times_s[kept]).any():
        times_s = clean["clock_s"] - np.nanmin(clean["clock_s"], initial=np.inf)
    kept = kept & np.isfinite(times_s)
    if not kept.any():
        raise BadInputError(
            f"{path}: this {kind} file has neither usable times nor photo names, "
            "so its positions cannot be given to frames"
        )
    _, first = np.unique(times_s[kept], return_index=True)
    rows = np.flatnonzero(kept)
    back = int((np.diff(times_s[rows]) < 0).sum())
    warnings = [f"{path.name}: time runs backwards {back} times; records were sorted"]
    kept = np.zeros_like(kept)
    kept[rows[first]] = True
    return times_s, kept, warnings if back else []
