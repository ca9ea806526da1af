"""Logs of ArduPilot: .bin from the vehicle, .tlog from the ground (extra ``mavlink``)."""

from collections import defaultdict
from collections.abc import Callable, Mapping
from contextlib import closing
from math import degrees, nan
from pathlib import Path
from typing import Any

from geometry.errors import BadInputError, report_as_bad_input
from locate.telemetry.assemble import ColumnStore, Record
from locate.telemetry.bounded import check_size, suppress_output
from locate.telemetry.streams import (
    YAW_FROM_NORTH,
    LogStream,
    track_from_streams,
    yaw_pitch_roll_deg,
)
from locate.telemetry.track import AltitudeDatum, TelemetryTrack

BIN_KIND, TLOG_KIND = "ArduPilot log", "MAVLink tlog"
INSTALL = "pip install 'plume-locate[mavlink]'"
"""What to do where pymavlink is missing."""
BIN_MAGIC = b"\xa3\x95"
MAX_TLOG_BYTES = 64 * 2**20
"""Larger logs are refused: their reader takes minutes."""
_FIRST_UTC_S = 1e9
"""Smaller time stamps count from the start of the autopilot."""


def looks_like_tlog(head: bytes) -> bool:
    """Whether a file begins with a time stamp and a MAVLink packet."""
    return (
        len(head) > 8
        and head[8] in (0xFE, 0xFD)
        and head[:2] in (b"\x00\x04", b"\x00\x05", b"\x00\x06")
    )


def read_bin(path: Path) -> TelemetryTrack:
    """Reads a DataFlash log at the rate of its filter (POS), or else of its receiver (GPS).

    Heights are above mean sea level.

    Raises:
        BadInputError: Not a readable log, no positions in it, or the extra is missing.
    """
    check_size(path)
    with report_as_bad_input(path, f"{BIN_KIND} file", missing=INSTALL), suppress_output():
        with closing(_open_bin(path)) as log:
            found = _read_streams(log, _BIN_RECORDS)
        position = found.pop("POS", None) or found.pop("GPS", None) or LogStream.from_records([])
        return track_from_streams(
            path, BIN_KIND, position, *found.values(), datum=AltitudeDatum.MEAN_SEA_LEVEL
        )


def read_tlog(path: Path) -> TelemetryTrack:
    """Reads the telemetry stream that a ground station kept; heights are above mean sea level.

    Raises:
        BadInputError: Not a readable log, no positions in it, or the extra is missing.
    """
    check_size(path, MAX_TLOG_BYTES)
    with report_as_bad_input(path, f"{TLOG_KIND} file", missing=INSTALL), suppress_output():
        from pymavlink import mavutil

        with closing(mavutil.mavlogfile(str(path))) as log:
            found = _read_streams(log, _TLOG_RECORDS)
        position = found.pop("GLOBAL_POSITION_INT", None) or LogStream.from_records([])
        return track_from_streams(
            path, TLOG_KIND, position, *found.values(), datum=AltitudeDatum.MEAN_SEA_LEVEL
        )


def _read_streams(log: Any, records: Mapping[str, Callable[[Any], Record]]) -> dict[str, LogStream]:
    """Messages by type: those of the first vehicle, and of the first of several sensors."""
    stores: dict[str, ColumnStore] = defaultdict(ColumnStore)
    senders: dict[str, object] = {}
    for message in iter(lambda: log.recv_match(type=list(records)), None):
        kind = message.get_type().split("[")[0]
        sender = _message_sender(message)
        if kind in records and sender == senders.setdefault(kind, sender):
            stores[kind].add(records[kind](message))
    columns = {kind: store.arrays() for kind, store in stores.items()}
    return {
        kind: LogStream.from_records(found.pop("times_s"), **found)
        for kind, found in columns.items()
    }


def _message_sender(message: Any) -> object:
    of_vehicle = getattr(message, "get_srcSystem", None)
    return of_vehicle() if of_vehicle else getattr(message, "I", 0)


def _position_record(m: Any) -> Record:
    height_m = getattr(m, "RelHomeAlt", nan)
    return {
        "times_s": m.TimeUS * 1e-6,
        "latitude_deg": m.Lat,
        "longitude_deg": m.Lng,
        "altitude_m": m.Alt,
        "height_m": height_m,
    }


def _receiver_record(m: Any) -> Record:
    if m.Status < 2:
        return {"times_s": nan}
    utc_s = m._timestamp if m._timestamp > _FIRST_UTC_S else nan
    return _position_record(m) | {"clock_s": utc_s}


def _accuracy_record(m: Any) -> Record:
    return {
        "times_s": m.TimeUS * 1e-6,
        "horizontal_sigma_m": m.HAcc,
        "vertical_sigma_m": m.VAcc,
    }


def _attitude_record(m: Any) -> Record:
    return {
        "times_s": m.TimeUS * 1e-6,
        "vehicle_yaw_deg": m.Yaw,
        "vehicle_pitch_deg": m.Pitch,
        "vehicle_roll_deg": m.Roll,
    }


def _mount_record(m: Any) -> Record:
    return {
        "times_s": m.TimeUS * 1e-6,
        "gimbal_yaw_deg": getattr(m, "YawE", nan),
        "gimbal_pitch_deg": m.Pitch,
        "gimbal_roll_deg": m.Roll,
    }


def _global_position_record(m: Any) -> Record:
    return {
        "times_s": m._timestamp,
        "clock_s": m._timestamp,
        "latitude_deg": m.lat * 1e-7,
        "longitude_deg": m.lon * 1e-7,
        "altitude_m": m.alt * 1e-3,
        "height_m": m.relative_alt * 1e-3,
    }


def _raw_gps_record(m: Any) -> Record:
    return {
        "times_s": m._timestamp,
        "horizontal_sigma_m": getattr(m, "h_acc", 0) * 1e-3,
        "vertical_sigma_m": getattr(m, "v_acc", 0) * 1e-3,
    }


def _mavlink_attitude_record(m: Any) -> Record:
    return {
        "times_s": m._timestamp,
        "vehicle_yaw_deg": degrees(m.yaw),
        "vehicle_pitch_deg": degrees(m.pitch),
        "vehicle_roll_deg": degrees(m.roll),
    }


def _gimbal_record(m: Any) -> Record:
    (yaw,), (pitch,), (roll,) = yaw_pitch_roll_deg([m.q])
    return {
        "times_s": m._timestamp,
        "gimbal_yaw_deg": yaw if m.flags & YAW_FROM_NORTH else nan,
        "gimbal_pitch_deg": pitch,
        "gimbal_roll_deg": roll,
    }


_BIN_RECORDS = {
    "POS": _position_record,
    "GPS": _receiver_record,
    "GPA": _accuracy_record,
    "ATT": _attitude_record,
    "MNT": _mount_record,
}
_TLOG_RECORDS = {
    "GLOBAL_POSITION_INT": _global_position_record,
    "GPS_RAW_INT": _raw_gps_record,
    "ATTITUDE": _mavlink_attitude_record,
    "GIMBAL_DEVICE_ATTITUDE_STATUS": _gimbal_record,
}


def _open_bin(path: Path) -> Any:
    """The reader of pymavlink, kept from walking on the spot where a format claims no length."""
    from pymavlink import DFReader

    if not DFReader.dfindexer.available:
        raise BadInputError(
            f"{path}: the pymavlink here was built without its indexer; install a wheel"
        )

    class BoundedReader(DFReader.DFReader_binary):  # type: ignore[misc]
        steps_left = path.stat().st_size + 1_000

        def __init__(self) -> None:
            try:
                super().__init__(str(path))
            except BaseException:
                self.filehandle.close()
                raise

        def _parse_next(self) -> Any:
            self.steps_left -= 1
            if self.steps_left < 0:
                raise BadInputError(f"{path}: not a readable {BIN_KIND} file (it runs in circles)")
            return super()._parse_next()

    return BoundedReader()
