"""The subtitles that drones write beside or into their videos, in all their dialects.

Newer ones of DJI give ``[latitude: ..] [longtitude: ..]`` (so spelt on the Mavic 2), ``[rel_alt: ..
abs_alt: ..]``, ``G.PRY (pitch, roll, yaw)`` or ``[gb_yaw: ..]``; older ones and Autel's give
``GPS(..)``, see `gps_tuples`. What is of no known form is left out, and its line is named.
"""

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from math import isfinite, nan
from pathlib import Path

from locate.telemetry.assemble import Record, columns_of, track_from_columns
from locate.telemetry.cells import UnknownForm, parse_coordinate
from locate.telemetry.clock import DATE_TIME, parse_date_time
from locate.telemetry.gps_tuples import (
    GpsTuple,
    TupleOrder,
    decide_order,
    find_gps_tuple,
    tuple_record,
)
from locate.telemetry.refused import RefusedText, raise_if_all_refused, summarize_refused
from locate.telemetry.track import Clock, TelemetryTrack

KIND = "DJI SRT"
_NUMBER = r"[-+]?\d{1,12}(?:\.\d{1,12})?"
_CUE = re.compile(r"(\d{1,3}):(\d{2}):(\d{2})[,.](\d{1,3}) {0,3}--> {0,3}[\d:,.]{5,16}")
_PAIR = re.compile(rf"\b([a-z_]{{2,16}}) ?: ?({_NUMBER})(?=[\s\]<m])(?!\s?(?:ft|feet)\b)")
_COORDINATE_KEY = re.compile(r"\b(latitude|longt?itude)\s?:")
_COORDINATE = re.compile(
    r"([^\[\]<\n]{0,80}?)\s{0,3},?\s{0,3}(?:[\[\]<\n]|(?=\b[a-z_.]{2,16}\s?:))"
)
_ANGLES = re.compile(r"\b(f\.pry|g\.pry) ?\(([^()]{3,80})\)")
_ANGLE = re.compile(rf"\s*({_NUMBER})\s?(?:°|º|â?°|deg|\ufffd{{1,2}})?\s*")
_HEIGHT = re.compile(rf"\bh ({_NUMBER})m")
_SPEED = re.compile(rf"\bh\.s ({_NUMBER})m/s")
_KEYS = {
    "altitude": "altitude_m",
    "abs_alt": "altitude_m",
    "rel_alt": "height_m",
    "barometer": "height_m",
    "hb": "height_m",
    "reh": "height_m",
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
        BadInputError: No subtitle holds a position of a known form.
    """
    cues = list(_timed_cues(text)) or list(_untimed_cues(text))
    lines = [line for line, _, _ in cues]
    return track_of_cues(((time_s, body) for _, time_s, body in cues), path, KIND, lines)


def _timed_cues(text: str) -> Iterator[tuple[int, float, str]]:
    """Line, time and text of each subtitle."""
    starts = list(_CUE.finditer(text))
    ends = [*(start.start() for start in starts), len(text)][1:]
    line, counted = 1, 0
    for start, end in zip(starts, ends, strict=True):
        line, counted = line + text.count("\n", counted, start.start()), start.start()
        yield line, _cue_seconds(*start.groups()), text[start.end() : end]


def _untimed_cues(text: str) -> Iterator[tuple[int, float, str]]:
    line = 1
    for block in re.split(r"(\n\s{0,8}\n)", text):
        if block.strip():
            yield line, nan, block
        line += block.count("\n")


def track_of_cues(
    cues: Iterable[tuple[float, str]], path: Path, kind: str, lines: Sequence[int] = ()
) -> TelemetryTrack:
    """A track of the times and texts of subtitles.

    Args:
        cues: Time (s) and text of each.
        path: The file.
        kind: Its format, for people.
        lines: The line in the file on which each begins, where it has lines.

    Raises:
        BadInputError: No subtitle holds a position of a known form.
    """
    records: list[Record] = []
    tuples: dict[int, tuple[GpsTuple, int]] = {}
    refused: list[RefusedText] = []
    for index, (time_s, body) in enumerate(cues):
        line = lines[index] if lines else 0
        record = {"times_s": time_s, **_cue_record(body.lower(), line, refused)}
        if not _COORDINATE_KEY.search(body.lower()):
            at = _line_of("gps", body, line)
            try:
                entry = find_gps_tuple(body)
            except UnknownForm as error:
                refused.append(RefusedText(at, "GPS", _gps_text(body), str(error), True))
            else:
                tuples |= {} if entry is None else {index: (entry, at)}
        records.append(record)
    _add_positions(records, tuples, refused)
    columns = columns_of(records)
    raise_if_all_refused(path, columns, refused)
    return track_from_columns(
        path, kind, columns, clock=Clock.LOCAL, warnings=summarize_refused(path, refused)
    )


def _add_positions(
    records: Sequence[Record],
    tuples: Mapping[int, tuple[GpsTuple, int]],
    refused: list[RefusedText],
) -> None:
    """Puts the tuples of a file into its records, all in one order."""
    try:
        order = decide_order([entry for entry, _ in tuples.values()])
    except UnknownForm as error:
        plain = {i: pair for i, pair in tuples.items() if pair[0].order is not TupleOrder.LETTERED}
        refused += [
            RefusedText(line, "GPS", entry.text, str(error), True) for entry, line in plain.values()
        ]
        tuples, order = {i: tuples[i] for i in tuples.keys() - plain.keys()}, TupleOrder.LETTERED
    for index, (entry, _) in tuples.items():
        records[index].update(tuple_record(entry, order))


def _gps_text(body: str) -> str:
    start = body.lower().find("gps")
    return body[start:].split("\n", 1)[0]


def _line_of(word: str, body: str, line: int) -> int:
    return line and line + body.count("\n", 0, max(body.lower().find(word), 0))


def _cue_seconds(hours: str, minutes: str, seconds: str, fraction: str) -> float:
    return int(hours) * 3600 + int(minutes) * 60 + float(f"{seconds}.{fraction}")


def _cue_record(body: str, line: int, refused: list[RefusedText]) -> Record:
    """The values of one subtitle, in lower case, all but its ``GPS(..)``."""
    record: Record = {"clock_s": parse_date_time(body)[0]}
    for key, value in _PAIR.findall(body):
        if key in _KEYS:
            record[_KEYS[key]] = float(value)
    for key, pattern in (("height_m", _HEIGHT), ("speed_mps", _SPEED)):
        if found := pattern.search(body):
            record[key] = float(found.group(1))
    for key, inside in _ANGLES.findall(body):
        parts = [_ANGLE.fullmatch(part) for part in inside.split(",")]
        if len(parts) == 3 and all(parts):
            what = "gimbal" if key == "g.pry" else "vehicle"
            for name, part in zip(_PITCH_ROLL_YAW, parts, strict=True):
                record[f"{what}_{name}_deg"] = float(part[1]) if part else nan
    return record | _coordinates(body, line, refused)


def _coordinates(body: str, line: int, refused: list[RefusedText]) -> Record:
    """The position given by ``latitude:`` and ``longitude:``; empty if of no known form."""
    found: Record = {}
    for key in _COORDINATE_KEY.finditer(body):
        axis = "latitude" if key[1] == "latitude" else "longitude"
        value = _COORDINATE.match(body, key.end())
        text = value[1] if value else body[key.end() : key.end() + 80]
        try:
            if value is None:
                raise UnknownForm("cut off")
            degrees = parse_coordinate(text, axis)
            if found.get(f"{axis}_deg", degrees) != degrees and isfinite(degrees):
                raise UnknownForm("a second one that differs")
        except UnknownForm as error:
            at = _line_of(axis, body, line)
            refused.append(RefusedText(at, axis, text, str(error), True))
            return {}
        found[f"{axis}_deg"] = degrees
    return found
