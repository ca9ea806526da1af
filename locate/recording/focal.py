"""The focal length that a photo or a video claims in its metadata."""

import re
import struct
from dataclasses import dataclass
from pathlib import Path

import pycolmap

from geometry.regular_files import open_regular
from locate.recording.decoders import heif_exif
from locate.recording.formats import PhotoKind, kind_of_photo

HEADER_BYTES = 256 * 1024
"""Beginning of a file that is searched for metadata."""
FULL_FRAME_WIDTH_MM = 36.0
"""Width of 35 mm film, which equivalent focal lengths refer to."""
EXIF_IFD, FOCAL_MM, PIXELS_X, PIXELS_Y = 0x8769, 0x920A, 0xA002, 0xA003
PLANE_X_RESOLUTION, PLANE_UNIT, FOCAL_35MM = 0xA20E, 0xA210, 0xA405
UNIT_MM = {2: 25.4, 3: 10.0, 4: 1.0, 5: 0.001}
"""Length units of EXIF, by code."""
TEXT = 2
"""Type of a text."""
_TYPES = {1: "B", 3: "H", 4: "I", 5: "II", 9: "i", 10: "ii"}
"""Number types of EXIF, by code, as `struct` names them."""
_VIDEO_KEY = re.compile(r"focal.?length.*35", re.IGNORECASE)
_DJI_CALIBRATED = re.compile(rb'CalibratedFocalLength(?:="|>)\s*([\d.]+)')


@dataclass(frozen=True, kw_only=True)
class FocalPrior:
    """A focal length from metadata.

    Attributes:
        relative: Focal length over the longest side of the image, so that resizing leaves it alone.
        source: Where it was found, for the report.
    """

    relative: float
    source: str


def focal_of_photo(path: Path) -> FocalPrior | None:
    """Reads XMP and EXIF of a photo; None where they hold no focal length.

    EXIF pixel dimensions may state the size of an original that was since resized, so the sensor
    size is worked out from those and the focal length taken relative to the image's side.
    """
    header = read_header(path)
    tags = exif_tags(header)
    side = max(tags.get(PIXELS_X, 0.0), tags.get(PIXELS_Y, 0.0))
    calibrated = _DJI_CALIBRATED.search(header)
    if calibrated and side > 0:
        return _plausible_prior(float(calibrated.group(1)) / side, "XMP CalibratedFocalLength")
    unit_mm = UNIT_MM.get(int(tags.get(PLANE_UNIT, 2)), 0.0)
    resolution = tags.get(PLANE_X_RESOLUTION, 0.0)
    if tags.get(FOCAL_MM, 0.0) > 0 and resolution > 0 and side > 0 and unit_mm > 0:
        sensor_mm = side / resolution * unit_mm
        return _plausible_prior(
            tags[FOCAL_MM] / sensor_mm, "EXIF FocalLength and FocalPlaneXResolution"
        )
    if tags.get(FOCAL_35MM, 0.0) > 0:
        return _plausible_prior(
            tags[FOCAL_35MM] / FULL_FRAME_WIDTH_MM, "EXIF FocalLengthIn35mmFilm"
        )
    return _from_camera_database(path) if FOCAL_MM in tags else None


def read_header(path: Path) -> bytes:
    """The part of a photo that holds its metadata: its beginning, after the EXIF of HEIC.

    Raises:
        OSError: The file cannot be read.
    """
    with open_regular(path) as file:
        header = file.read(HEADER_BYTES)
    is_heif = kind_of_photo(path, header) is PhotoKind.HEIF
    return heif_exif(path) + header if is_heif else header


def focal_of_video(metadata: dict[str, str]) -> FocalPrior | None:
    """Reads the 35 mm equivalent focal length that some phones write into their videos."""
    for key, value in metadata.items():
        number = re.search(r"\d+(\.\d+)?", value)
        if _VIDEO_KEY.search(key) and number:
            return _plausible_prior(
                float(number.group()) / FULL_FRAME_WIDTH_MM, f"video metadata {key}"
            )
    return None


def _plausible_prior(relative: float, source: str) -> FocalPrior | None:
    return FocalPrior(relative=relative, source=source) if 0.2 < relative < 20 else None


def _from_camera_database(path: Path) -> FocalPrior | None:
    bitmap = pycolmap.Bitmap.read(path, as_rgb=False)
    focal_px = None if bitmap is None else bitmap.exif_focal_length()
    if bitmap is None or not focal_px:
        return None
    side = max(bitmap.width, bitmap.height)
    return _plausible_prior(float(focal_px) / side, "EXIF FocalLength and sensor database")


def exif_tags(header: bytes) -> dict[int, float]:
    """Numeric tags of the main and the EXIF directory (EXIF 2.32, section 4.6.2)."""
    tiff, order = _tiff_part(header)
    if order is None:
        return {}
    try:
        (offset,) = struct.unpack_from(order + "I", tiff, 4)
        tags = _read_directory(tiff, order, offset)
        if EXIF_IFD in tags:
            tags |= _read_directory(tiff, order, int(tags[EXIF_IFD]))
    except struct.error:
        return {}
    return tags


def exif_texts(header: bytes) -> dict[int, str]:
    """Texts of the same directories."""
    tiff, order = _tiff_part(header)
    if order is None:
        return {}
    try:
        (offset,) = struct.unpack_from(order + "I", tiff, 4)
        texts = _read_texts(tiff, order, offset)
        inner = _read_directory(tiff, order, offset).get(EXIF_IFD)
        if inner is not None:
            texts |= _read_texts(tiff, order, int(inner))
    except struct.error:
        return {}
    return texts


def _tiff_part(header: bytes) -> tuple[bytes, str | None]:
    """Where the directories are, and their byte order; None without any."""
    start = header.find(b"Exif\0\0")
    tiff = header[start + 6 :] if start >= 0 else header
    return tiff, {b"II": "<", b"MM": ">"}.get(tiff[:2])


def _read_texts(tiff: bytes, order: str, offset: int) -> dict[int, str]:
    (count,) = struct.unpack_from(order + "H", tiff, offset)
    texts = {}
    for i in range(count):
        entry = offset + 2 + 12 * i
        tag, kind, n = struct.unpack_from(order + "HHI", tiff, entry)
        if kind == TEXT:
            position = entry + 8
            if n > 4:  # longer values stand elsewhere
                (position,) = struct.unpack_from(order + "I", tiff, position)
            content = tiff[position : position + n].split(b"\0")[0]
            texts[tag] = content.decode("latin-1").strip()
    return texts


def _read_directory(tiff: bytes, order: str, offset: int) -> dict[int, float]:
    (count,) = struct.unpack_from(order + "H", tiff, offset)
    tags = {}
    for i in range(count):
        entry = offset + 2 + 12 * i
        tag, kind, n = struct.unpack_from(order + "HHI", tiff, entry)
        layout = _TYPES.get(kind)
        if layout is None or n != 1:
            continue
        position = entry + 8
        if struct.calcsize(layout) > 4:
            (position,) = struct.unpack_from(order + "I", tiff, position)
        values = struct.unpack_from(order + layout, tiff, position)
        tags[tag] = values[0] / (values[1] or 1) if len(values) == 2 else float(values[0])
    return tags
