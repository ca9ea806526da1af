"""Where photos were taken, by their own EXIF and XMP."""

import logging
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from io import BytesIO
from math import hypot, isfinite, isnan, nan, sqrt
from pathlib import Path
from typing import Any, BinaryIO
from xml.etree import ElementTree

import exifread
import numpy as np

from geometry.arrays import FloatArray
from geometry.errors import BadInputError, report_as_bad_input
from geometry.regular_files import open_regular
from locate.recording.decoders import heif_exif
from locate.recording.formats import PhotoKind, kind_of_photo
from locate.recording.photo_folder import list_photos
from locate.telemetry.assemble import Record, columns_of, track_from_columns
from locate.telemetry.cells import (
    LENGTHS,
    UnknownForm,
    parse_coordinate,
    parse_quantity,
    reference_sign,
)
from locate.telemetry.clock import parse_date_time, posix_s
from locate.telemetry.refused import RefusedText, raise_if_all_refused, summarize_refused
from locate.telemetry.track import AltitudeDatum, Clock, TelemetryTrack

logging.getLogger("exifread").setLevel(logging.CRITICAL)  # a line for each photo without EXIF
KIND = "photo"
XMP_BYTES = 2**20
"""The XMP of a photo is within its first bytes, so many."""
_NUMBER = re.compile(r"[-+]?\d{1,12}(?:\.\d{0,15})?")
_BELOW, _ELLIPSOIDAL = (1, 3), (2, 3)  # values of GPSAltitudeRef, EXIF 3.0, table 17
_XMP_END = b"</x:xmpmeta>"
_XMP_COLUMNS = {
    "GpsLatitude": "latitude_deg",
    "GpsLongitude": "longitude_deg",
    "GpsLongtitude": "longitude_deg",
    "AbsoluteAltitude": "altitude_m",
    "RelativeAltitude": "height_m",
    "GimbalYawDegree": "gimbal_yaw_deg",
    "GimbalPitchDegree": "gimbal_pitch_deg",
    "GimbalRollDegree": "gimbal_roll_deg",
    "FlightYawDegree": "vehicle_yaw_deg",
    "FlightPitchDegree": "vehicle_pitch_deg",
    "FlightRollDegree": "vehicle_roll_deg",
    "RtkStdHgt": "vertical_sigma_m",
}


def read_photos(path: Path) -> TelemetryTrack:
    """Reads EXIF and DJI's XMP of one photo, or of all photos of a folder.

    A photo whose metadata cannot be read is one without a position. Positions and altitudes that
    a writer put as text are read where they have one known form; otherwise, as other values that
    are no angle or have no hemisphere, they are left out with a warning. Altitudes count from mean
    sea level as EXIF defines, or from the ellipsoid where EXIF 3.0 or DJI (``RtkAlt``) states that.

    Raises:
        BadInputError: No photos, or none with a position.
    """
    if not path.is_dir():
        refused: list[RefusedText] = []
        return _make_track(path, [path], [_read_photo(path, refused)], refused)
    photos, _ = list_photos(path)
    refused = []
    records = [_read_photo_or_empty(photo, refused) for photo in photos]
    return _make_track(path, photos, records, refused)


@dataclass(frozen=True, kw_only=True)
class PhotoClocks:
    """When N photos were taken.

    Attributes:
        clock_s: (N,) s since 1970 on `clock`; NaN where a photo states no time.
        clock: UTC where a photo states one that is, else local.
    """

    clock_s: FloatArray
    clock: Clock


def read_photo_clocks(folder: Path, names: Sequence[str]) -> PhotoClocks:
    """When photos of a folder were taken, by their EXIF."""
    records = [_read_photo_or_empty(folder / name, []) for name in names]
    key, clock = _clock_key(records)
    clock_s = np.array([record.get(key, nan) for record in records], dtype=float)
    return PhotoClocks(clock_s=clock_s, clock=clock)


def _clock_key(records: Sequence[Record]) -> tuple[str, Clock]:
    in_utc = any("utc_s" in record for record in records)
    return ("utc_s", Clock.UTC) if in_utc else ("local_s", Clock.LOCAL)


def _make_track(
    path: Path, photos: Sequence[Path], records: Sequence[Record], refused: Sequence[RefusedText]
) -> TelemetryTrack:
    key, clock = _clock_key(records)
    for record in records:
        record["clock_s"] = record.get(key, nan)
    ellipsoidal = {record["ellipsoidal"] for record in records if "altitude_m" in record}
    datum = AltitudeDatum.ELLIPSOID if ellipsoidal == {1.0} else AltitudeDatum.MEAN_SEA_LEVEL
    columns = columns_of(records)
    raise_if_all_refused(path, columns, refused)
    return track_from_columns(
        path,
        KIND,
        columns,
        datum=AltitudeDatum.UNKNOWN if len(ellipsoidal) > 1 else datum,
        clock=clock,
        names=[photo.name for photo in photos],
        warnings=summarize_refused(path, refused),
    )


def _read_photo_or_empty(photo: Path, refused: list[RefusedText]) -> Record:
    try:
        return _read_photo(photo, refused)
    except BadInputError:
        return {}


def _read_photo(photo: Path, refused: list[RefusedText]) -> Record:
    with report_as_bad_input(photo, f"{KIND} file"), open_regular(photo) as file:
        header = file.read(XMP_BYTES)
        file.seek(0)
        is_heif = kind_of_photo(photo, header) is PhotoKind.HEIF
        exif: BinaryIO = BytesIO(heif_exif(photo).removeprefix(b"Exif\0\0")) if is_heif else file
        tags = exifread.process_file(exif, details=False, extract_thumbnail=False)
    found: list[RefusedText] = []
    with report_as_bad_input(photo, f"{KIND} file"):
        xmp, own = _xmp_record(header), _exif_record(tags, photo.name, found)
    record = xmp | own
    has_position = {"latitude_deg", "longitude_deg"} <= record.keys()
    refused += [entry for entry in found if not (entry.is_position and has_position)]
    return record | {"ellipsoidal": max(xmp.get("ellipsoidal", 0.0), own["ellipsoidal"])}


def _exif_record(tags: Mapping[str, Any], name: str, refused: list[RefusedText]) -> Record:
    values = {key: getattr(tag, "values", None) for key, tag in tags.items()}
    record: Record = {}
    if str(values.get("GPS GPSStatus", "A")).strip("\0 ") != "V":  # V: no fix, an old position
        try:
            record["latitude_deg"] = _coordinate(values, "latitude")
            record["longitude_deg"] = _coordinate(values, "longitude")
        except UnknownForm as error:
            record = {}
            refused.append(RefusedText(0, "GPS position", name, str(error), True))
    (reference,) = _tag_numbers(values, "GPS GPSAltitudeRef", 1)
    try:
        altitude_m = _altitude_m(values)
        record["altitude_m"] = -altitude_m if reference in _BELOW else altitude_m
    except UnknownForm as error:
        refused.append(RefusedText(0, "GPS altitude", name, str(error), False))
    record["horizontal_sigma_m"] = _tag_numbers(values, "GPS Tag 0x001F", 1)[0]
    record = {key: value for key, value in record.items() if isfinite(value)}
    record["ellipsoidal"] = float(reference in _ELLIPSOIDAL)
    return record | _clock_record(values)


def _clock_record(values: Mapping[str, Any]) -> Record:
    record: Record = {}
    day = str(values.get("GPS GPSDate", "")).strip("\0 ").replace("-", ":").split(":")
    hour, minute, second = _tag_numbers(values, "GPS GPSTimeStamp", 3)
    if len(day) == 3 and all(part.isdecimal() for part in day) and isfinite(hour + minute + second):
        year, month, date = (int(part) for part in day)
        record["utc_s"] = posix_s(year, month, date, int(hour), int(minute), second)
    stamp, fraction, zone = (
        str(values.get(f"EXIF {name}", "")).strip("\0 ")
        for name in ("DateTimeOriginal", "SubSecTimeOriginal", "OffsetTimeOriginal")
    )
    taken_s, zoned = parse_date_time(f"{stamp}.{fraction}{zone}" if fraction else stamp + zone)
    return {"utc_s" if zoned else "local_s": taken_s} | record


def _xmp_record(header: bytes) -> Record:
    """The values of DJI's XMP, which stand in attributes or in elements.

    What is parsed begins at the first element, so no document type can define an entity.
    """
    start, end = header.find(b"<x:xmpmeta"), header.find(_XMP_END)
    try:
        elements = list(ElementTree.fromstring(header[max(start, 0) : end + len(_XMP_END)]).iter())
    except ElementTree.ParseError:
        return {}
    stated: dict[str, str] = {}
    for element in elements:
        stated |= {_local_name(key): value for key, value in element.attrib.items()}
        stated[_local_name(element.tag)] = element.text or ""
    numbers = {key: _parse_number(value) for key, value in stated.items()}
    record = {column: numbers[key] for key, column in _XMP_COLUMNS.items() if key in numbers}
    if "RtkStdLat" in numbers and "RtkStdLon" in numbers:
        sigma_m = hypot(numbers["RtkStdLat"], numbers["RtkStdLon"]) / sqrt(2)
        record["horizontal_sigma_m"] = sigma_m
    record["ellipsoidal"] = float(stated.get("AltitudeType") == "RtkAlt")
    return {key: value for key, value in record.items() if isfinite(value)}


def _local_name(tag: str) -> str:
    return tag.rsplit("}", 1)[-1]


def _coordinate(values: Mapping[str, Any], axis: str) -> float:
    """Degrees of the GPSLatitude or GPSLongitude of EXIF; NaN where there is none.

    Raises:
        UnknownForm: It is no angle of 0 to 90 or 180 degrees with a hemisphere.
    """
    name = f"GPS GPS{axis.capitalize()}"
    found, reference = values.get(name), _text(values.get(f"{name}Ref", ""))
    if isinstance(found, str):
        return parse_coordinate(_text(found), axis, reference)
    degrees, minutes, seconds = numbers = _tag_numbers(values, name, 3)
    if all(isnan(number) for number in numbers) or not (any(numbers) or reference):
        return nan
    sign = reference_sign(reference, axis)
    if not (degrees >= 0 and 0 <= minutes <= 60 and 0 <= seconds <= 60):
        raise UnknownForm(f"the {axis} is no degrees, minutes and seconds")
    size = degrees + minutes / 60 + seconds / 3600
    if size > (90 if axis == "latitude" else 180):
        raise UnknownForm(f"beyond the largest {axis}")
    return sign * size


def _altitude_m(values: Mapping[str, Any]) -> float:
    found = values.get("GPS GPSAltitude")
    if isinstance(found, str):
        return parse_quantity(_text(found), LENGTHS)
    return _tag_numbers(values, "GPS GPSAltitude", 1)[0]


def _text(value: object) -> str:
    return str(value).strip("\0 ")


def _tag_numbers(values: Mapping[str, Any], name: str, count: int) -> list[float]:
    """`count` numbers of a tag; NaN where it has fewer, a text, or a ratio over 0."""
    found = values.get(name)
    is_list = isinstance(found, Sequence) and not isinstance(found, str | bytes)
    numbers = list(found)[:count] if found is not None and is_list else []
    numbers += [None] * (count - len(numbers))
    return [_ratio_value(number) for number in numbers]


def _ratio_value(number: object) -> float:
    above, below = getattr(number, "num", number), getattr(number, "den", 1)
    if not isinstance(above, int | float) or not isinstance(below, int | float):
        return nan
    return above / below if below else nan


def _parse_number(text: str) -> float:
    return float(text) if _NUMBER.fullmatch(text.strip()) else nan
