"""Samples of more than 8 bits: one scale for a whole recording, of photos and of video."""

from pathlib import Path

import av
import cv2
import numpy as np
import pytest

from geometry.stretch import Stretch
from locate.recording import open_recording, select_frames
from locate.recording.frame_files import FrameFiles
from locate.recording.images import read_grey

HEIGHT, WIDTH = 96, 160


def scene(shift: int = 0) -> np.ndarray:
    """Smooth texture from 0 to 1 that moves on by `shift` px."""
    random = np.random.default_rng(0).random((HEIGHT, 3 * WIDTH))
    smooth = cv2.GaussianBlur(random, (0, 0), 2)
    smooth = (smooth - smooth.min()) / np.ptp(smooth)
    return np.asarray(smooth[:, shift : shift + WIDTH])


def centikelvin(shift: int = 0, *, coldest: float = 29000, range_: float = 1500) -> np.ndarray:
    return np.rint(coldest + range_ * scene(shift)).astype(np.uint16)


def write_photos(folder: Path, images: list[np.ndarray], suffix: str = ".tiff") -> Path:
    folder.mkdir()
    for i, image in enumerate(images):
        assert cv2.imwrite(str(folder / f"{i:03d}{suffix}"), image)
    return folder


def write_deep_video(path: Path, images: list[np.ndarray], kind: str) -> Path:
    """A lossless video whose luma holds these samples."""
    with av.open(str(path), "w") as container:
        stream = container.add_stream("ffv1", rate=20)
        stream.width, stream.height, stream.pix_fmt = WIDTH, HEIGHT, kind
        for i, image in enumerate(images):
            frame = av.VideoFrame(WIDTH, HEIGHT, kind)
            for k, plane in enumerate(frame.planes):
                rows = np.full(plane.buffer_size // 2, 512, "<u2").reshape(-1, plane.line_size // 2)
                if k == 0:
                    rows[:HEIGHT, :WIDTH] = image
                plane.update(rows.tobytes())
            frame.pts = i
            container.mux(stream.encode(frame))
        container.mux(stream.encode(None))
    return path


def assert_linear(values: np.ndarray, greys: np.ndarray, *, worst: float) -> None:
    """Asserts that the greys are one line of the values, but for rounding and the ends."""
    inside = (greys > 0) & (greys < 255)
    slope, offset = np.polyfit(values[inside], greys[inside], 1)
    assert slope > 0
    assert np.abs(slope * values + offset - greys)[inside].max() < worst


@pytest.mark.parametrize("suffix", [".tiff", ".png", ".jp2"])
def test_centikelvin_photos_keep_their_levels_on_one_scale(tmp_path: Path, suffix: str) -> None:
    images = [centikelvin(10 * i, coldest=29000 + 100 * i) for i in range(5)]
    recording = open_recording(write_photos(tmp_path / "photos", images, suffix))
    frames = [frame.image for frame in recording.frames()]
    assert min(len(np.unique(frame)) for frame in frames) > 180
    assert_linear(np.stack(images).astype(float), np.stack(frames).astype(float), worst=2.0)
    (note,) = recording.warnings
    assert "samples of more than 8 bits: values from 29" in note
    assert "chosen from 5 of them" in note


def test_temperatures_of_floating_point_are_shown_on_one_scale(tmp_path: Path) -> None:
    images = [(15 + 12 * scene(10 * i) + i / 5).astype(np.float32) for i in range(5)]
    images[2][:3] = np.nan
    recording = open_recording(write_photos(tmp_path / "photos", images))
    frames = [frame.image for frame in recording.frames()]
    assert min(len(np.unique(frame)) for frame in frames) > 180
    assert not frames[2][:3].any()
    known = np.isfinite(np.stack(images))
    assert_linear(np.stack(images)[known], np.stack(frames)[known].astype(float), worst=1.0)
    (note,) = recording.warnings
    assert "samples are real numbers: 15." in note


def test_frames_of_a_run_are_written_on_that_scale(tmp_path: Path) -> None:
    images = [centikelvin(8 * i, coldest=29000 + 60 * i) for i in range(6)]
    recording = open_recording(write_photos(tmp_path / "photos", images))
    kept = select_frames(recording, tmp_path / "frames")
    written = [
        cv2.imread(str(tmp_path / "frames" / name), cv2.IMREAD_UNCHANGED) for name in kept.names
    ]
    values = np.stack([images[index] for index in kept.indices]).astype(float)
    assert_linear(values, np.stack(written).astype(float), worst=1.0)
    assert any("samples of more than 8 bits" in note for note in kept.warnings)


def test_detectors_see_the_photos_on_that_scale(tmp_path: Path) -> None:
    images = [centikelvin(8 * i, coldest=29000 + 200 * i) for i in range(3)]
    recording = open_recording(write_photos(tmp_path / "photos", images))
    seen = FrameFiles.of(recording, tmp_path).frames().images
    for frame, image in zip(recording.frames(), seen, strict=True):
        np.testing.assert_array_equal(image, frame.image)


def test_dead_pixels_and_borders_without_a_value_do_not_matter(tmp_path: Path) -> None:
    images = [centikelvin(10 * i) for i in range(4)]
    clean = open_recording(write_photos(tmp_path / "clean", images))
    for image in images:
        image[:20] = 0
        image[50, 50] = 65535
        image[51, 51] = 100
    marred = open_recording(write_photos(tmp_path / "marred", images))
    for one, other in zip(clean.frames(), marred.frames(), strict=True):
        difference = one.image[25:].astype(int) - other.image[25:]
        difference[25:27, 50:52] = 0
        assert np.abs(difference).max() < 8


@pytest.mark.parametrize("bits", [10, 12, 14, 16])
def test_photos_that_use_their_range_keep_their_highest_bits(tmp_path: Path, bits: int) -> None:
    images = [np.rint(scene(i) * ((1 << bits) - 1)).astype(np.uint16) for i in range(3)]
    images.append(images[0] // 8)
    recording = open_recording(write_photos(tmp_path / "photos", images, ".png"))
    for frame, image in zip(recording.frames(), images, strict=True):
        np.testing.assert_array_equal(frame.image, image >> (bits - 8))


def test_eight_bits_written_as_sixteen_are_the_eight_bits(tmp_path: Path) -> None:
    grey = np.rint(scene() * 255).astype(np.uint8)
    cv2.imwrite(str(tmp_path / "a.png"), grey.astype(np.uint16) * 257)
    np.testing.assert_array_equal(read_grey(tmp_path / "a.png"), grey)


@pytest.mark.parametrize("suffix", [".png", ".tiff", ".bmp", ".jp2"])
def test_eight_bits_are_left_as_they_are(tmp_path: Path, suffix: str) -> None:
    images = [np.rint(100 + 30 * scene(i)).astype(np.uint8) for i in range(3)]
    recording = open_recording(write_photos(tmp_path / "photos", images, suffix))
    for frame, image in zip(recording.frames(), images, strict=True):
        stored = cv2.imread(str(tmp_path / "photos" / frame.source), cv2.IMREAD_UNCHANGED)
        np.testing.assert_array_equal(frame.image, stored)
        assert np.abs(frame.image.astype(int) - image).max() <= 8
    assert recording.warnings == []


def test_photos_of_two_depths_are_noted(tmp_path: Path) -> None:
    folder = write_photos(tmp_path / "photos", [centikelvin(5 * i) for i in range(4)])
    cv2.imwrite(str(folder / "004.png"), np.rint(scene(9) * 255).astype(np.uint8))
    recording = open_recording(folder)
    assert len(list(recording.frames())) == 5
    assert any("1 of 5 photos have 8 bits" in note for note in recording.warnings)


@pytest.mark.parametrize(
    ("kind", "low", "range_"),
    [
        ("gray16le", 29000, 1000),
        ("gray10le", 300, 200),
        ("gray12le", 2000, 500),
        ("yuv420p10le", 300, 200),
        ("yuv422p10le", 600, 150),
    ],
)
def test_flat_video_of_many_bits_is_stretched(
    tmp_path: Path, kind: str, low: int, range_: int
) -> None:
    images = [np.rint(low + 2 * i + range_ * scene(2 * i)).astype(np.uint16) for i in range(20)]
    recording = open_recording(write_deep_video(tmp_path / "v.mkv", images, kind))
    frames = [frame.image for frame in recording.frames()]
    assert_linear(np.stack(images).astype(float), np.stack(frames).astype(float), worst=1.5)
    assert min(np.ptp(frame.astype(int)) for frame in frames) > 180
    assert "samples of more than 8 bits" in recording.warnings[0]


@pytest.mark.parametrize("kind", ["gray16le", "gray10le", "yuv420p10le"])
def test_video_that_uses_its_range_keeps_all_its_bits(tmp_path: Path, kind: str) -> None:
    most = 65535 if kind == "gray16le" else 1023
    images = [np.rint(most * (0.1 + 0.8 * scene(2 * i))).astype(np.uint16) for i in range(6)]
    path = write_deep_video(tmp_path / "v.mkv", images, kind)
    recording = open_recording(path)
    with av.open(str(path)) as container:
        decoded = list(container.decode(video=0))
    for frame, stored in zip(recording.frames(), decoded, strict=True):
        deep = stored.to_ndarray(format="gray16le")
        np.testing.assert_array_equal(recording.full_size(frame), deep)
        np.testing.assert_array_equal(frame.image, deep >> 8)
    assert recording.sizes.has_full_size
    assert recording.warnings == []


def test_image_without_contrast_stays_plain() -> None:
    flat = np.full((20, 30), 29000, np.uint16)
    flat[5, 5] = 29001
    scale = Stretch.choose([flat])
    assert scale is not None
    assert np.ptp(scale.apply(flat).astype(int)) <= 4
    assert Stretch.choose([]) is None
