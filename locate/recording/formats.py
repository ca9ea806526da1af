"""Formats of photos: recognised by name and content, and by which library each is read."""

import struct
from enum import Enum
from pathlib import Path

from geometry import MOST_PIXELS
from geometry.decoded_size import MOST_DECODED_BYTES

HEIF_SUFFIXES = frozenset({".heic", ".heif", ".hif"})
RAW_SUFFIXES = frozenset(
    {".dng", ".cr2", ".cr3", ".nef", ".arw", ".raf", ".orf", ".rw2", ".pef", ".srw"}
)
"""What cameras write before they make a picture of it."""
DEEP_SUFFIXES = HEIF_SUFFIXES | RAW_SUFFIXES | {".png", ".tif", ".tiff", ".jp2", ".j2k", ".avif"}
"""Formats whose samples may have more than 8 bits."""
PHOTO_SUFFIXES = DEEP_SUFFIXES | {".jpg", ".jpeg", ".webp", ".bmp"}
READ = "JPEG, PNG, TIFF, WebP, BMP, JPEG 2000, AVIF, HEIC or raw"
"""The formats that are read, for messages."""
TOO_LARGE = (
    f"over {MOST_PIXELS // 10**6} megapixels, or over {MOST_DECODED_BYTES // 2**30} GiB while it "
    "is decoded; cut or reduce it"
)
"""Why an image, or the frames of a video, are not read."""

_HEIF_BRANDS = frozenset({b"heic", b"heix", b"heim", b"heis", b"hevc", b"hevx", b"mif1", b"msf1"})
_DNG_VERSION = 50706
"""Tag of TIFF that makes a file DNG."""
_TAG_BYTES = 12
"""Of an entry of a TIFF directory."""


class PhotoKind(Enum):
    """By what a photo is decoded; the value is its name for people."""

    PLAIN = "photo"
    HEIF = "HEIC/HEIF photo"
    RAW = "raw photo"


def kind_of_photo(path: Path, content: bytes = b"") -> PhotoKind:
    """The kind of a photo of this name and content.

    Phones name HEIC files .jpg, and the first picture in a DNG file is a small preview: so the
    content decides as well as the name.
    """
    suffix = path.suffix.lower()
    if _is_heif(content) or (suffix in HEIF_SUFFIXES and not content.startswith(b"\xff\xd8")):
        return PhotoKind.HEIF
    if suffix in RAW_SUFFIXES or _is_dng(content):
        return PhotoKind.RAW
    return PhotoKind.PLAIN


def _is_heif(content: bytes) -> bool:
    is_avif = b"avif" in content[8:64]
    return content[4:8] == b"ftyp" and content[8:12] in _HEIF_BRANDS and not is_avif


def _is_dng(content: bytes) -> bool:
    """Whether the first directory of a TIFF file has the version of DNG."""
    order = {b"II*\0": "<", b"MM\0*": ">"}.get(content[:4])
    if order is None:
        return False
    try:
        (start,) = struct.unpack_from(f"{order}I", content, 4)
        (count,) = struct.unpack_from(f"{order}H", content, start)
        tags = [
            struct.unpack_from(f"{order}H", content, start + 2 + _TAG_BYTES * k)[0]
            for k in range(count)
        ]
    except struct.error:
        return False
    return _DNG_VERSION in tags
