"""Logs of PX4 autopilots (ULog, extra ``px4``)."""

from pathlib import Path
from typing import Any

import numpy as np

from geometry.arrays import FloatArray
from geometry.errors import BadInputError
from locate.telemetry.bounded import check_size, report_as_bad_input, suppress_output
from locate.telemetry.streams import (
    YAW_FROM_NORTH,
    LogStream,
    track_from_streams,
    yaw_pitch_roll_deg,
)
from locate.telemetry.track import AltitudeDatum, TelemetryTrack

KIND = "PX4 ULog"
MAGIC = b"ULog\x01\x12\x35"
_FUSED, _ATTITUDE, _GIMBAL = (
    "vehicle_global_position",
    "vehicle_attitude",
    "gimbal_device_attitude_status",
)
_RECEIVER = ("vehicle_gps_position", "sensor_gps")


def read_ulog(path: Path) -> TelemetryTrack:
    """Reads a ULog at the rate of its receiver, or of its filter where that was logged.

    Heights are ellipsoidal where the log has them, above mean sea level otherwise.

    Raises:
        BadInputError: Not a readable ULog, no positions in it, or the extra is missing.
    """
    check_size(path)
    wanted = [_FUSED, *_RECEIVER, _ATTITUDE, _GIMBAL]
    with report_as_bad_input(path, KIND, extra="px4"), suppress_output(), path.open("rb") as file:
        from pyulog import ULog

        log = ULog(file, message_name_filter_list=wanted)
        topics = {data.name: data.data for data in reversed(log.data_list)}
        receiver = next((topics[name] for name in _RECEIVER if name in topics), None)
        positions = topics.get(_FUSED, receiver)
        if positions is None:
            raise BadInputError(f"{path}: this log has no position topic ({_FUSED}, sensor_gps)")
        position, datum = _position_stream(positions)
        others = [_clock_stream(receiver)] if receiver else []
        others += [
            _attitude_stream(topics[name], what)
            for name, what in ((_ATTITUDE, "vehicle"), (_GIMBAL, "gimbal"))
            if name in topics
        ]
        return track_from_streams(path, KIND, position, *others, datum=datum)


def _position_stream(data: dict[str, Any]) -> tuple[LogStream, AltitudeDatum]:
    """A position topic; until PX4 1.14 receivers gave integers of 1e-7 degrees and mm."""
    in_degrees = data.get("latitude_deg", data["lat"] if "fix_type" not in data else None)
    fixed = data["fix_type"] >= 2 if "fix_type" in data else np.True_
    if in_degrees is not None:
        latitude = in_degrees
        longitude = data["longitude_deg"] if "longitude_deg" in data else data["lon"]
    else:
        latitude, longitude = data["lat"] * 1e-7, data["lon"] * 1e-7
    altitudes = (
        ("altitude_ellipsoid_m", 1.0, AltitudeDatum.ELLIPSOID),
        ("alt_ellipsoid", 1e-3 if "fix_type" in data else 1.0, AltitudeDatum.ELLIPSOID),
        ("altitude_msl_m", 1.0, AltitudeDatum.MEAN_SEA_LEVEL),
        ("alt", 1e-3 if "fix_type" in data else 1.0, AltitudeDatum.MEAN_SEA_LEVEL),
    )
    altitude_m, datum = next(
        ((data[key] * factor, datum) for key, factor, datum in altitudes if key in data),
        (np.full(len(data["timestamp"]), np.nan), AltitudeDatum.UNKNOWN),
    )
    stream = LogStream.from_records(
        _log_seconds(data),
        latitude_deg=np.where(fixed, latitude, np.nan),
        longitude_deg=np.where(fixed, longitude, np.nan),
        altitude_m=altitude_m,
        horizontal_sigma_m=data["eph"],
        vertical_sigma_m=data["epv"],
    )
    return stream, datum


def _clock_stream(data: dict[str, Any]) -> LogStream:
    utc_s = data["time_utc_usec"] * 1e-6
    return LogStream.from_records(_log_seconds(data), clock_s=np.where(utc_s > 0, utc_s, np.nan))


def _attitude_stream(data: dict[str, Any], what: str) -> LogStream:
    yaw, pitch, roll = yaw_pitch_roll_deg(np.column_stack([data[f"q[{i}]"] for i in range(4)]))
    if "device_flags" in data:
        yaw = np.where(data["device_flags"] & YAW_FROM_NORTH, yaw, np.nan)
    named = {f"{what}_yaw_deg": yaw, f"{what}_pitch_deg": pitch, f"{what}_roll_deg": roll}
    return LogStream.from_records(_log_seconds(data), **named)


def _log_seconds(data: dict[str, Any]) -> FloatArray:
    return np.asarray(data["timestamp"], dtype=float) * 1e-6
