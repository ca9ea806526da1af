"""Logs of PX4 autopilots (ULog, extra ``px4``)."""

from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from geometry.arrays import FloatArray
from geometry.errors import BadInputError, report_as_bad_input
from geometry.regular_files import open_regular
from locate.telemetry.bounded import check_size, suppress_output
from locate.telemetry.streams import (
    YAW_FROM_NORTH,
    LogStream,
    track_from_streams,
    yaw_pitch_roll_deg,
)
from locate.telemetry.track import AltitudeDatum, TelemetryTrack

KIND = "PX4 ULog"
MAGIC = b"ULog\x01\x12\x35"
MOST_READINGS, SPARE_BYTES = 8, 2**21
"""How often a parser may read a log over, and what it may read of a small one; chosen. A whole log
is read once."""
MOST_FIELDS = 1_000_000
"""Of all topics of a log; a real one has some ten thousand."""
USUAL_NAME = 64
"""Characters of a field's name; a longer one counts for several fields."""
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
    with (
        report_as_bad_input(path, f"{KIND} file", missing="pip install 'plume-locate[px4]'"),
        suppress_output(),
        open_regular(path) as file,
    ):
        log = _parse_bounded(_RepeatLimitedFile(file, path), path, wanted)
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


class _RepeatLimitedFile:
    """A file that its parser may read a few times over, not for ever.

    pyulog steps back after each message of an unknown kind; at the end of a file it never ends.
    """

    def __init__(self, file: BinaryIO, path: Path) -> None:
        self._path = path
        self._left = MOST_READINGS * path.stat().st_size + SPARE_BYTES
        self._read = file.read
        self.seek, self.tell, self.close = file.seek, file.tell, file.close

    def read(self, count: int) -> bytes:
        """Reads as the file does, until all that may be read has been."""
        content = self._read(count)
        self._left -= len(content)
        if self._left < 0:
            raise BadInputError(f"{self._path}: not a readable {KIND} file (runs in circles)")
        return content


def _parse_bounded(file: _RepeatLimitedFile, path: Path, wanted: list[str]) -> Any:
    """A parsed log, whose formats may not unfold without end."""
    from pyulog import ULog

    left = MOST_FIELDS

    class BoundedULog(ULog):  # type: ignore[misc]
        class _MessageAddLogged(ULog._MessageAddLogged):  # type: ignore[misc]
            def _parse_nested_type(
                self, prefix_str: str, type_name: str, message_formats: dict[str, Any]
            ) -> None:
                nonlocal left
                left -= sum(
                    max(size, 1) * (1 + (len(prefix_str) + len(name)) // USUAL_NAME)
                    for _, size, name in message_formats[type_name].fields
                )
                if left < 0:
                    raise BadInputError(f"{path}: not a readable {KIND} file (too many fields)")
                super()._parse_nested_type(prefix_str, type_name, message_formats)

    return BoundedULog(file, message_name_filter_list=wanted)


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
