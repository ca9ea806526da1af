"""The subtitles that DJI drones write beside or into their videos, in all their dialects.

Old ones give ``GPS(longitude,latitude,satellites) BAROMETER:height``, the Matrice 300
``GPS(latitude,longitude,altitude M)``, newer ones ``[latitude: ..] [longtitude: ..]`` (so spelt on
the Mavic 2), ``[rel_alt: .. abs_alt: ..]``, ``G.PRY (pitch, roll, yaw)`` or ``[gb_yaw: ..]``.
"""

import re
from collections.abc import Iterable
from math import nan
from pathlib import Path

from locate.telemetry.assemble import Record, columns_of, track_from_columns
from locate.telemetry.clock import DATE_TIME, parse_date_time
from locate.telemetry.track import Clock, TelemetryTrack

KIND = "DJI SRT"
_NUMBER = r"[-+]?\d{1,12}(?:\.\d{1,12})?"
_CUE = re.compile(r"(\d{1,3}):(\d{2}):(\d{2})[,.](\d{1,3}) {0,3}--> {0,3}[\d:,.]{5,16}")
_PAIR = re.compile(rf"\b([a-z_]{{2,16}}) ?: ?({_NUMBER})(?=[\s\]<m])")
_TUPLE = re.compile(r"\b(gps|f\.pry|g\.pry) ?\(([^()]{3,80})\)")
_IN_TUPLE = re.compile(rf"({_NUMBER})( ?m)?")
_HEIGHT = re.compile(rf"\bh ({_NUMBER})m")
_SPEED = re.compile(rf"\bh\.s ({_NUMBER})m/s")
_KEYS = {
    "latitude": "latitude_deg",
    "longitude": "longitude_deg",
    "longtitude": "longitude_deg",
    "altitude": "altitude_m",
    "abs_alt": "altitude_m",
    "rel_alt": "height_m",
    "barometer": "height_m",
    "hb": "height_m",
    "gb_yaw": "gimbal_yaw_deg",
    "gb_pitch": "gimbal_pitch_deg",
    "gb_roll": "gimbal_roll_deg",
}
_PITCH_ROLL_YAW = ("pitch", "roll", "yaw")


def looks_like_srt(head: str) -> bool:
    """Whether a text begins like subtitles, or like the DJI ones that lack their times."""
    return bool(_CUE.search(head)) or ("latitude" in head and bool(DATE_TIME.search(head)))


def parse_srt(text: str, path: Path) -> TelemetryTrack:
    """Reads the text of a .SRT file.

    Times are the starts of the subtitles, that is on the clock of the video; without them, the
    dates inside, counted from the first. Altitudes are given with no word on their datum.

    Raises:
        BadInputError: No subtitle holds a position.
    """
    parts = _CUE.split(text)
    if len(parts) > 1:
        starts = (parts[i : i + 5] for i in range(1, len(parts), 5))
        cues = ((_cue_seconds(*stamp), body) for *stamp, body in starts)
    else:
        cues = ((nan, block) for block in re.split(r"\n\s{0,8}\n", text))
    return track_of_cues(cues, path, KIND)


def track_of_cues(cues: Iterable[tuple[float, str]], path: Path, kind: str) -> TelemetryTrack:
    """A track of the times and texts of subtitles.

    Raises:
        BadInputError: No subtitle holds a position.
    """
    records = ({"times_s": time_s, **_cue_record(body.lower())} for time_s, body in cues)
    return track_from_columns(path, kind, columns_of(records), clock=Clock.LOCAL)


def _cue_seconds(hours: str, minutes: str, seconds: str, fraction: str) -> float:
    return int(hours) * 3600 + int(minutes) * 60 + float(f"{seconds}.{fraction}")


def _cue_record(body: str) -> Record:
    """The values of one subtitle, in lower case."""
    record: Record = {"clock_s": parse_date_time(body)[0]}
    for key, value in _PAIR.findall(body):
        if key in _KEYS:
            record[_KEYS[key]] = float(value)
    for key, pattern in (("height_m", _HEIGHT), ("speed_mps", _SPEED)):
        if found := pattern.search(body):
            record[key] = float(found.group(1))
    for key, inside in _TUPLE.findall(body):
        values = [(float(number), bool(unit)) for number, unit in _IN_TUPLE.findall(inside)]
        if len(values) == 3:
            record |= _position_values(values) if key == "gps" else _angle_values(key, values)
    return record


def _position_values(values: list[tuple[float, bool]]) -> Record:
    (first, _), (second, _), (third, in_metres) = values
    if in_metres:
        return {"latitude_deg": first, "longitude_deg": second, "altitude_m": third}
    return {"longitude_deg": first, "latitude_deg": second}


def _angle_values(key: str, values: list[tuple[float, bool]]) -> Record:
    what = "gimbal" if key == "g.pry" else "vehicle"
    named = zip(_PITCH_ROLL_YAW, values, strict=True)
    return {f"{what}_{name}_deg": value for name, (value, _) in named}
