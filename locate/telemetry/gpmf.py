"""The telemetry track inside GoPro videos (GPMF): keys, lengths and values, nested.

Each packet of the track holds a second of several sensors. Of the GPS, cameras up to the Hero 10
write ``GPS5`` with ``GPSF`` (fix), ``GPSU`` (UTC) and ``SCAL``, later ones ``GPS9``, whose samples
have a fix and a time each. Source: github.com/gopro/gpmf-parser, its README.
"""

import struct
from collections.abc import Iterator
from math import nan
from pathlib import Path
from typing import NamedTuple

import av
import numpy as np
from av.stream import Discard

from geometry.arrays import FloatArray
from geometry.errors import BadInputError, report_as_bad_input
from locate.recording.container import open_container, start_of_video_s
from locate.telemetry.assemble import Record, columns_of, track_from_columns
from locate.telemetry.bounded import MAX_LOG_BYTES
from locate.telemetry.clock import posix_s
from locate.telemetry.track import AltitudeDatum, Clock, TelemetryTrack

KIND = "GoPro GPMF"
DEVICE = b"DEVC"
"""Key with which every packet begins."""
NESTED = 0
DEEPEST = 8
"""Levels of nesting; GoPro uses three."""
MOST_SAMPLES = 1_000_000
"""GPS samples; more than ten hours."""
FIRST_FIX = 2
"""Least value of GPSF that has a position: 2 for one without, 3 for one with a height."""
PACKET_S = 1.01
"""Length of a packet where the file states none."""
_TYPES = {
    ord("b"): "b", ord("B"): "B", ord("s"): "h", ord("S"): "H", ord("l"): "i", ord("L"): "I",
    ord("f"): "f", ord("d"): "d", ord("j"): "q", ord("J"): "Q",
}  # fmt: skip
_GPS9 = ">iiiiiiiHH"
"""Of one sample: latitude, longitude, altitude, two speeds, days, seconds, dilution, fix."""
_DATUMS = {b"MSLV": AltitudeDatum.MEAN_SEA_LEVEL, b"WGS8": AltitudeDatum.ELLIPSOID}
_DAYS_FROM_S = 946_684_800.0  # 2000-01-01


class KeyValue(NamedTuple):
    """One entry: its key, the code of its type, the size of an element, and its bytes."""

    key: bytes
    kind: int
    size: int
    value: bytes


def parse_entries(content: bytes) -> Iterator[KeyValue]:
    """The entries of one level, up to the first that is cut off or empty."""
    at = 0
    while at + 8 <= len(content):
        key, kind, size, count = struct.unpack_from(">4sBBH", content, at)
        length = size * count
        at += 8
        if key == b"\0\0\0\0" or at + length > len(content):
            return
        yield KeyValue(key, kind, size, content[at : at + length])
        at += -(-length // 4) * 4


def parse_streams(content: bytes, depth: int = 0) -> Iterator[dict[bytes, KeyValue]]:
    """The entries of each innermost group that holds GPS, by their keys."""
    entries = {}
    for entry in parse_entries(content):
        if entry.kind == NESTED and depth < DEEPEST:
            yield from parse_streams(entry.value, depth + 1)
        else:
            entries[entry.key] = entry
    if b"GPS5" in entries or b"GPS9" in entries:
        yield entries


def read_gpmf(path: Path) -> TelemetryTrack | None:
    """Reads the GPS of a GoPro video; times count from its first frame. None without such a track.

    Samples without a fix have no position. The datum of the altitudes is that which ``GPSA``
    states, else unknown.

    Raises:
        BadInputError: Not a readable video, or no sample has a position.
    """
    packets, records = 0, list[Record]()
    datums: set[AltitudeDatum] = set()
    with report_as_bad_input(path, "video file"), open_container(path) as container:
        for time_s, length_s, content in _packets(container):
            packets += 1
            for stream in parse_streams(content):
                datums.add(_datum(stream))
                found = _gps9_records(stream) if b"GPS9" in stream else _gps5_records(stream)
                times_s = [time_s + length_s * i / len(found) for i in range(len(found))]
                records += [r | {"times_s": t} for r, t in zip(found, times_s, strict=True)]
            if len(records) > MOST_SAMPLES:
                raise BadInputError(f"{path}: over {MOST_SAMPLES} GPS samples; cut the video")
    if not packets:
        return None
    if not records:
        raise BadInputError(f"{path}: its GoPro telemetry holds no GPS; was it switched on?")
    datum = datums.pop() if len(datums) == 1 else AltitudeDatum.UNKNOWN
    return track_from_columns(path, KIND, columns_of(records), datum=datum, clock=Clock.UTC)


def _packets(container: "av.container.InputContainer") -> Iterator[tuple[float, float, bytes]]:
    """Time and length (s) and content of the packets of the first track that is GPMF."""
    start_s, left, track = start_of_video_s(container), MAX_LOG_BYTES, None
    for stream in container.streams:
        if stream.type != "data":
            stream.discard = Discard.all  # so that gigabytes of images are not read
    for packet in container.demux(*container.streams.data) if container.streams.data else ():
        content = bytes(packet)
        if packet.pts is None or not content.startswith(DEVICE):
            continue
        track = packet.stream.index if track is None else track
        if packet.stream.index != track:
            continue
        left -= len(content)
        if left < 0:
            most = f"{MAX_LOG_BYTES // 2**20} MiB"
            raise BadInputError(f"{container.name}: its telemetry is over {most}; cut the video")
        length_s = float((packet.duration or 0) * packet.time_base) or PACKET_S
        yield float(packet.pts * packet.time_base) - start_s, length_s, content


def _numbers(entry: KeyValue | None, columns: int) -> FloatArray:
    """(N, columns) of an entry; none where its type or size is another."""
    letter = _TYPES.get(entry.kind) if entry else None
    if entry is None or letter is None:
        return np.zeros((0, columns))
    values = np.frombuffer(
        entry.value[: len(entry.value) // struct.calcsize(letter) * struct.calcsize(letter)],
        dtype=np.dtype(letter).newbyteorder(">"),
    ).astype(float)
    return values[: len(values) // columns * columns].reshape(-1, columns)


def _scales(stream: dict[bytes, KeyValue], count: int) -> FloatArray:
    """(count,) what the values are divided by; NaN where it is not stated."""
    scales = _numbers(stream.get(b"SCAL"), 1).ravel()
    scales = np.where(scales == 0, nan, scales)
    if len(scales) == 1:
        return np.full(count, scales[0])
    return scales[:count] if len(scales) >= count else np.full(count, nan)


def _gps5_records(stream: dict[bytes, KeyValue]) -> list[Record]:
    rows = _numbers(stream[b"GPS5"], 5) / _scales(stream, 5)
    fix = _numbers(stream.get(b"GPSF"), 1)
    has_fix = bool(len(fix) and fix[0, 0] >= FIRST_FIX)
    clock_s = _clock_s(stream[b"GPSU"].value) if b"GPSU" in stream else nan
    records = [_position(row, has_fix=has_fix) for row in rows]
    if records:
        records[0]["clock_s"] = clock_s
    return records


def _gps9_records(stream: dict[bytes, KeyValue]) -> list[Record]:
    entry, scales = stream[b"GPS9"], _scales(stream, 9)
    step = struct.calcsize(_GPS9)
    if entry.size != step:
        return []
    whole = entry.value[: len(entry.value) // step * step]
    records = []
    for row in np.array(list(struct.iter_unpack(_GPS9, whole)), dtype=float).reshape(-1, 9):
        values = row / scales
        record = _position(values, has_fix=bool(values[8] >= FIRST_FIX))
        records.append(record | {"clock_s": _DAYS_FROM_S + values[5] * 86_400 + values[6]})
    return records


def _position(values: FloatArray, *, has_fix: bool) -> Record:
    keys = ("latitude_deg", "longitude_deg", "altitude_m", "speed_mps")
    known = values[:4] if has_fix else np.full(4, nan)
    return dict(zip(keys, map(float, known), strict=True))


def _datum(stream: dict[bytes, KeyValue]) -> AltitudeDatum:
    stated = stream[b"GPSA"].value[:4] if b"GPSA" in stream else b""
    return _DATUMS.get(stated, AltitudeDatum.UNKNOWN)


def _clock_s(text: bytes) -> float:
    """Seconds since 1970 of ``yymmddhhmmss.sss``; NaN for anything else."""
    try:
        digits = text[:16].decode("ascii")
        year, month, day, hour, minute = (int(digits[i : i + 2]) for i in range(0, 10, 2))
        return posix_s(2000 + year, month, day, hour, minute, float(digits[10:]))
    except (ValueError, TypeError):
        return nan
