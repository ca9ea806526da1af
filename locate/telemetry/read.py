"""Which parser a file of telemetry is for, by its content."""

from collections.abc import Callable
from pathlib import Path
from typing import TypeAlias

from geometry.errors import BadInputError
from geometry.regular_files import read_start
from locate.recording.formats import PhotoKind, kind_of_photo
from locate.telemetry import (
    ardupilot,
    ass,
    dji_mrk,
    dji_srt,
    geolocation,
    gpx,
    odm,
    table,
    ulog,
)
from locate.telemetry.bounded import read_telemetry_text
from locate.telemetry.gpmf import read_gpmf
from locate.telemetry.photos import read_photos
from locate.telemetry.subtitles import read_subtitles
from locate.telemetry.track import TelemetryTrack

HEAD_BYTES = 4096
"""Of a file, by which its format is recognised."""
SIDECARS = (".srt", ".ass", ".gpx", ".csv", ".ulg", ".bin", ".tlog", ".txt")
"""Suffixes of telemetry beside a video of the same name."""
AMONG_PHOTOS = (".gpx", ".csv")
"""Suffixes of telemetry in a folder of photos."""

_Text: TypeAlias = tuple[Callable[[str], bool], Callable[[str, Path], TelemetryTrack]]
_TEXTS: tuple[_Text, ...] = (
    (gpx.looks_like_gpx, gpx.parse_gpx),
    (ass.looks_like_ass, ass.parse_ass),
    (dji_mrk.looks_like_mrk, dji_mrk.parse_mrk),
    (odm.looks_like_odm, odm.parse_geo),
    (table.looks_like_table, table.parse_table),
    (geolocation.looks_like_geolocation, geolocation.parse_geolocation),
    (dji_srt.looks_like_srt, dji_srt.parse_srt),
)
_BINARIES: tuple[tuple[bytes, Callable[[Path], TelemetryTrack]], ...] = (
    (ulog.MAGIC, ulog.read_ulog),
    (ardupilot.BIN_MAGIC, ardupilot.read_bin),
    (b"\xff\xd8\xff", read_photos),
    (b"\x89PNG", read_photos),
    (b"II*\x00", read_photos),
    (b"MM\x00*", read_photos),
)


def read_telemetry(path: str | Path) -> TelemetryTrack:
    """Reads where a camera was from a log, a table, a video's subtitles or photos.

    Args:
        path: A DJI .SRT or .mrk, .ass of Autel, GPX, a table (CSV, exiftool, Airdata, senseFly
            geoinfo), a list of Pix4D, an ODM geo.txt, a PX4 or ArduPilot log, a video of a GoPro or
            with a subtitle track, a photo, or a folder of photos. The content decides, not the
            suffix.

    Raises:
        BadInputError: Nothing there, no known format, or no position in it.
    """
    path = Path(path)
    if not path.exists():
        raise BadInputError(f"{path}: no such file or folder")
    if path.is_dir():
        return read_photos(path)
    if not path.is_file():
        raise BadInputError(f"{path}: is no file")
    head = read_start(path, HEAD_BYTES)
    if not head.strip():
        raise BadInputError(f"{path}: is empty")
    for magic, read in _BINARIES:
        if head.startswith(magic):
            return read(path)
    if ardupilot.looks_like_tlog(head):
        return ardupilot.read_tlog(path)
    is_webp = head[:4] == b"RIFF" and head[8:12] == b"WEBP"
    if is_webp or kind_of_photo(path, head) is not PhotoKind.PLAIN:
        return read_photos(path)
    if b"\0" in head and not head.startswith((b"\xff\xfe", b"\xfe\xff")):
        return read_gpmf(path) or read_subtitles(path)
    return _read_text(path)


def telemetry_candidates(recording: Path) -> tuple[Path, ...]:
    """Where the telemetry of a recording may be, the likeliest first.

    A folder of photos has it in the photos, in a GPX or a table among them, or in a file of its
    name beside it; a video in itself, or in a file of the same name beside it (``DJI_0001.SRT``
    for ``DJI_0001.MP4``).
    """
    among: list[Path] = []
    stem = recording.stem
    if recording.is_dir():
        stem = recording.name
        among = sorted(path for path in recording.iterdir() if path.suffix.lower() in AMONG_PHOTOS)
    by_name = {path.name.lower(): path for path in recording.parent.iterdir()}
    names = [stem.lower() + suffix for suffix in SIDECARS]
    return (recording, *among, *(by_name[name] for name in names if name in by_name))


def _read_text(path: Path) -> TelemetryTrack:
    text = read_telemetry_text(path)
    for looks_like, parse in _TEXTS:
        if looks_like(text[:HEAD_BYTES]):
            return parse(text, path)
    raise BadInputError(
        f"{path}: no telemetry is recognised in it; expected a DJI .SRT or .mrk, .ass, GPX, a "
        "table with latitude and longitude, an ODM geo.txt, an autopilot log, a video or photos"
    )
