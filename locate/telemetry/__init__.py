"""Where a camera was, from whatever was recorded beside its images."""

from locate.telemetry.odm import GroundControl, read_ground_control
from locate.telemetry.offset import TimeOffset, estimate_offset, estimate_offset_from_turns
from locate.telemetry.profiles import path_speeds, path_turns_dps
from locate.telemetry.read import read_telemetry, telemetry_candidates
from locate.telemetry.refused import RefusedPositionsError
from locate.telemetry.track import AltitudeDatum, Clock, TelemetryTrack

__all__ = [
    "AltitudeDatum",
    "Clock",
    "GroundControl",
    "RefusedPositionsError",
    "TelemetryTrack",
    "TimeOffset",
    "estimate_offset",
    "estimate_offset_from_turns",
    "path_speeds",
    "path_turns_dps",
    "read_ground_control",
    "read_telemetry",
    "telemetry_candidates",
]
