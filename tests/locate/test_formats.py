"""Formats of photos: read, or refused by name with what to do."""

import struct
from pathlib import Path

import cv2
import numpy as np
import pytest

from geometry.errors import BadInputError
from locate.recording import open_recording

GREY = np.rint(cv2.GaussianBlur(np.random.default_rng(0).random((48, 64)), (0, 0), 2) * 255)
HEIC = struct.pack(">I", 24) + b"ftypheic" + bytes(4) + b"mif1heic" + bytes(200)


def dng(order: str) -> bytes:
    """A readable TIFF of 2x2 px, as the preview in a DNG file, with the tag of DNG's version."""
    tags = [(256, 3, 1, 2), (257, 3, 1, 2), (258, 3, 1, 8), (259, 3, 1, 1), (262, 3, 1, 1)]
    tags += [(273, 4, 1, 200), (278, 3, 1, 2), (279, 4, 1, 4), (50706, 1, 4, 1)]
    entries = b"".join(
        struct.pack(f"{order}HHI{'I' if kind == 4 else 'Hxx'}", tag, kind, count, value)
        for tag, kind, count, value in tags
    )
    magic = (b"II" if order == "<" else b"MM") + struct.pack(f"{order}HI", 42, 8)
    content = magic + struct.pack(f"{order}H", len(tags)) + entries + bytes(4)
    return content.ljust(200, b"\0") + b"\x10\x20\x30\x40"


@pytest.mark.parametrize("suffix", [".bmp", ".jp2", ".avif", ".webp", ".jpg", ".BMP"])
def test_formats_that_opencv_reads_are_read(tmp_path: Path, suffix: str) -> None:
    if not cv2.haveImageWriter(f"a{suffix.lower()}"):
        pytest.skip(f"OpenCV is built without {suffix}")
    (tmp_path / "photos").mkdir()
    for i in range(2):
        _, content = cv2.imencode(suffix.lower(), GREY.astype(np.uint8))
        (tmp_path / f"photos/{i}{suffix}").write_bytes(content.tobytes())
    for path in (tmp_path / "photos", tmp_path / f"photos/0{suffix}"):
        for frame in open_recording(path).frames():
            assert np.abs(frame.image - GREY).mean() < 3


@pytest.mark.parametrize("name", ["a.heic", "a.HEIF", "a.hif", "a.jpg"])
def test_heic_is_refused_by_name_also_under_another(tmp_path: Path, name: str) -> None:
    (tmp_path / name).write_bytes(HEIC)
    for path in (tmp_path / name, tmp_path):
        with pytest.raises(
            BadInputError, match=r"HEIC/HEIF photos are not read; convert"
        ) as caught:
            open_recording(path)
        assert name in str(caught.value)
        assert "\n" not in str(caught.value)


@pytest.mark.parametrize("name", ["a.dng", "a.DNG", "a.tif"])
@pytest.mark.parametrize("order", ["<", ">"])
def test_preview_in_a_dng_is_not_taken_for_the_photo(tmp_path: Path, name: str, order: str) -> None:
    (tmp_path / "preview.bin").write_bytes(dng(order))
    assert cv2.imread(str(tmp_path / "preview.bin")).shape == (2, 2, 3)
    (tmp_path / name).write_bytes(dng(order))
    for path in (tmp_path / name, tmp_path):
        with pytest.raises(BadInputError, match="raw photos are not read; develop them"):
            open_recording(path)


@pytest.mark.parametrize("name", ["a.cr2", "a.NEF", "a.arw"])
def test_raw_is_refused_by_name(tmp_path: Path, name: str) -> None:
    (tmp_path / name).write_bytes(b"II*\0" + bytes(100))
    with pytest.raises(BadInputError, match=r"a\.\w+: DNG and other raw photos are not read"):
        open_recording(tmp_path)


def test_photo_that_cannot_be_read_says_what_can(tmp_path: Path) -> None:
    (tmp_path / "a.png").write_bytes(b"nothing of the kind")
    with pytest.raises(BadInputError, match=r"a\.png: not a readable image \(JPEG, PNG, .*BMP"):
        open_recording(tmp_path)
