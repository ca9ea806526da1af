"""Formats of photos: read, or refused by name with what to do."""

import struct
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest
import tifffile

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


def write_raw(path: Path, *, half: bool = False) -> None:
    """A DNG of the grey picture before a mosaic of colour filters, without colour of its own."""
    ones = (1, 1) * 3
    unit = (1, 1, 0, 1, 0, 1, 0, 1, 1, 1, 0, 1, 0, 1, 0, 1, 1, 1)
    tags = [
        (50706, "B", 4, (1, 4, 0, 0)), (33421, "H", 2, (2, 2)), (33422, "B", 4, (0, 1, 1, 2)),
        (50708, "s", 0, "A camera"), (50714, "H", 1, 0), (50717, "H", 1, 65535),
        (50721, "2i", 9, unit), (50778, "H", 1, 21), (50728, "2I", 3, ones),
    ]  # fmt: skip
    samples = (GREY * (60 if half else 120)).astype(np.uint16)
    extra = [(*tag, True) for tag in tags]
    tifffile.imwrite(path, samples, photometric="cfa", extratags=extra, metadata=None)


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


@pytest.fixture
def no_extras(monkeypatch: pytest.MonkeyPatch) -> None:
    """As where the libraries of the extras are not installed."""
    monkeypatch.setattr("locate.recording.decoders.find_spec", lambda name: None)
    for module in ("pi_heif", "rawpy"):
        monkeypatch.setitem(sys.modules, module, None)


@pytest.mark.usefixtures("no_extras")
@pytest.mark.parametrize(
    ("name", "content", "said"),
    [
        ("a.heic", HEIC, r"HEIC/HEIF photos, pip install 'plume-locate\[heif\]', or convert"),
        ("a.HIF", HEIC, r"HEIC/HEIF photos, pip install 'plume-locate\[heif\]', or convert"),
        ("a.jpg", HEIC, r"HEIC/HEIF photos, pip install 'plume-locate\[heif\]', or convert"),
        ("a.NEF", b"II*\0", r"raw photos, pip install 'plume-locate\[raw\]', or develop"),
        ("a.dng", dng("<"), r"raw photos, pip install 'plume-locate\[raw\]', or develop"),
        ("a.tif", dng(">"), r"raw photos, pip install 'plume-locate\[raw\]', or develop"),
    ],
)
def test_missing_extras_are_named(tmp_path: Path, name: str, content: bytes, said: str) -> None:
    (tmp_path / name).write_bytes(content)
    for path in (tmp_path / name, tmp_path):
        with pytest.raises(BadInputError, match=said) as caught:
            open_recording(path)
        assert name in str(caught.value)
        assert "\n" not in str(caught.value)


@pytest.mark.usefixtures("no_extras")
def test_photos_of_a_missing_extra_are_counted_beside_others(tmp_path: Path) -> None:
    for i in range(2):
        cv2.imwrite(str(tmp_path / f"{i}.jpg"), GREY)
    (tmp_path / "2.heic").write_bytes(HEIC)
    (note,) = open_recording(tmp_path).warnings
    assert "HEIC/HEIF photo, extra not installed: 1 (2.heic)" in note


@pytest.mark.parametrize("name", ["a.heic", "a.jpg", "a.hif"])
@pytest.mark.parametrize("bits", [8, 10])
def test_heic_photos_are_read(tmp_path: Path, name: str, bits: int) -> None:
    pytest.importorskip("pi_heif", reason="the extra `heif` is not installed")
    pillow_heif = pytest.importorskip("pillow_heif", reason="nothing here writes HEIC")
    samples = np.repeat(GREY.astype(np.uint8)[..., None], 3, 2)
    deep = samples.astype(np.uint16) << 8
    mode, data = ("RGB", samples) if bits == 8 else ("RGB;16", deep)
    exif = b"Exif\0\0MM\0*" + struct.pack(">IHHHII", 8, 1, 0x8769, 4, 1, 26)
    exif += struct.pack(">IHHHIHHI", 0, 1, 0xA405, 3, 1, 28, 0, 0)
    photo = pillow_heif.from_bytes(mode=mode, size=GREY.shape[::-1], data=data.tobytes())
    with (tmp_path / name).open("wb") as file:
        photo.save(file, quality=95, exif=exif)
    recording = open_recording(tmp_path, one_camera=True)
    (frame,) = recording.frames()
    assert frame.image.shape == GREY.shape
    assert np.corrcoef(frame.image.ravel(), GREY.ravel())[0, 1] > 0.99
    assert recording.focal is not None
    assert recording.focal.relative == pytest.approx(28 / 36)
    assert (recording.stretch is not None) == (bits == 10 and name != "a.jpg")


@pytest.mark.parametrize("name", ["a.dng", "a.DNG", "a.tif"])
def test_raw_photos_are_developed(tmp_path: Path, name: str) -> None:
    pytest.importorskip("rawpy", reason="the extra `raw` is not installed")
    write_raw(tmp_path / name)
    recording = open_recording(tmp_path, one_camera=True)
    (frame,) = recording.frames()
    assert recording.stretch is not None
    assert frame.image.shape == GREY.shape
    assert np.corrcoef(frame.image.ravel(), GREY.ravel())[0, 1] > 0.98


def test_photos_of_one_exposure_stay_alike(tmp_path: Path) -> None:
    pytest.importorskip("rawpy", reason="the extra `raw` is not installed")
    write_raw(tmp_path / "0.dng")
    write_raw(tmp_path / "1.dng", half=True)
    whole, half = (frame.image.astype(float) for frame in open_recording(tmp_path).frames())
    assert half.max() < 0.8 * whole.max()


@pytest.mark.parametrize("name", ["a.heic", "a.dng"])
def test_damaged_photos_of_extras_are_refused(tmp_path: Path, name: str) -> None:
    pytest.importorskip("pi_heif", reason="the extra `heif` is not installed")
    pytest.importorskip("rawpy", reason="the extra `raw` is not installed")
    (tmp_path / name).write_bytes(HEIC if name == "a.heic" else dng("<"))
    with pytest.raises(BadInputError, match=rf"{name}: not a readable (HEIC/HEIF|raw) photo"):
        open_recording(tmp_path)


def test_one_photo_in_two_formats_counts_once(tmp_path: Path) -> None:
    for i in range(3):
        cv2.imwrite(str(tmp_path / f"{i}.jpg"), GREY)
    write_raw(tmp_path / "0.DNG")
    cv2.imwrite(str(tmp_path / "1.png"), GREY)
    recording = open_recording(tmp_path)
    assert [photo.name for photo in recording.photos] == ["0.jpg", "1.jpg", "2.jpg"]
    (note,) = recording.warnings
    assert "1.png" in note or "0.DNG" in note


def test_photo_that_cannot_be_read_says_what_can(tmp_path: Path) -> None:
    (tmp_path / "a.png").write_bytes(b"nothing of the kind")
    with pytest.raises(BadInputError, match=r"a\.png: not a readable image \(JPEG, PNG, .*BMP"):
        open_recording(tmp_path)
