"""Autopilot logs: several streams of records at their own rates, brought onto one clock."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Self

import numpy as np
from numpy.typing import ArrayLike

from geometry.arrays import FloatArray
from locate.telemetry.assemble import track_from_columns
from locate.telemetry.resample import interpolate
from locate.telemetry.track import MAX_GAP_S, PERIOD_DEG, AltitudeDatum, Clock, TelemetryTrack

YAW_FROM_NORTH = 16 | 64
"""MAVLink's GIMBAL_DEVICE_FLAGS_YAW_LOCK and _YAW_IN_EARTH_FRAME; else yaw is from the vehicle."""


@dataclass(frozen=True, kw_only=True)
class LogStream:
    """Records of one kind in a log.

    Attributes:
        times_s: (N,) ascending, on the log's clock.
        columns: (N,) each, by their name in a `TelemetryTrack`.
    """

    times_s: FloatArray
    columns: Mapping[str, FloatArray]

    @classmethod
    def from_records(cls, times_s: ArrayLike, **columns: ArrayLike) -> Self:
        """Makes a stream of unordered records."""
        stamps_s = np.asarray(times_s, dtype=float)
        order = np.argsort(stamps_s, kind="stable")
        order = order[np.isfinite(stamps_s[order])]
        taken = {key: np.asarray(column, dtype=float)[order] for key, column in columns.items()}
        return cls(times_s=stamps_s[order], columns=taken)

    def __len__(self) -> int:
        return len(self.times_s)


def track_from_streams(
    path: Path, kind: str, position: LogStream, *others: LogStream, datum: AltitudeDatum
) -> TelemetryTrack:
    """A track at the times of `position`, with the `others` interpolated to them.

    Raises:
        BadInputError: No record has a position.
    """
    columns = dict(position.columns)
    for other in others:
        for key, values in other.columns.items():
            if len(other) and key not in columns:
                columns[key] = interpolate(
                    position.times_s, other.times_s, values, MAX_GAP_S, period=PERIOD_DEG.get(key)
                )
    first_s = position.times_s[0] if len(position) else 0.0
    columns["times_s"] = position.times_s - first_s
    return track_from_columns(path, kind, columns, datum=datum, clock=Clock.UTC)


def yaw_pitch_roll_deg(wxyz: ArrayLike) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Yaw, pitch and roll, each (N,), of (N, 4) quaternions ned_from_body (w first).

    Source: Diebel, Representing Attitude, 2006, eq. 290; NaN for quaternions far from length 1.
    """
    q = np.asarray(wxyz, dtype=float).reshape(-1, 4)
    length = np.linalg.norm(q, axis=1, keepdims=True)
    w, x, y, z = np.where(np.abs(length - 1) < 0.1, q / np.where(length > 0, length, 1), np.nan).T
    yaw = np.arctan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))
    pitch = np.arcsin(np.clip(2 * (w * y - x * z), -1, 1))
    roll = np.arctan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y))
    return np.degrees(yaw), np.degrees(pitch), np.degrees(roll)
