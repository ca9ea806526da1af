"""What lies beside the photos of a folder is skipped and counted; names may be any bytes."""

import os
import struct
from pathlib import Path

import cv2
import numpy as np
import pytest
import tifffile

from geometry.errors import BadInputError
from geometry.printable import printable
from locate.pipeline.config import RunConfig
from locate.pipeline.fingerprint import fingerprint_path
from locate.recording import KeyFrames, open_recording, select_frames
from locate.recording.photo_folder import list_photos
from locate.recording.stack import TiffStack
from locate.recording.tiff_pages import TiffPages
from locate.telemetry import read_telemetry
from tests.locate.test_video import pan, write_photos

LATIN_1 = os.fsdecode(b"caf\xe9")


def photos_in(folder: Path, count: int = 4, suffix: str = ".jpg") -> Path:
    return write_photos(folder, pan([20.0 * i for i in range(count)]), suffix)


def write_thumbnail(path: Path) -> None:
    cv2.imwrite(str(path), cv2.resize(pan([0.0])[0], (80, 60), interpolation=cv2.INTER_AREA))


def test_leavings_are_skipped_and_counted(tmp_path: Path) -> None:
    folder = photos_in(tmp_path / "photos")
    (folder / "dir.jpg").mkdir()
    (folder / "999.JPG").symlink_to(folder / "gone.jpg")
    (folder / "empty.png").touch()
    (folder / "notes.txt").write_text("windy")
    (folder / "videos").mkdir()
    (folder / ".hidden.jpg").write_bytes(b"not counted")
    os.mkfifo(folder / "pipe.jpg")
    write_thumbnail(folder / "IMG_000_thumb.jpg")
    write_thumbnail(folder / "img1_thumb.png")
    kept = select_frames(open_recording(folder), tmp_path / "frames")
    assert [frame.source for frame in kept.frames] == [f"img{i}.jpg" for i in range(1, 5)]
    (note,) = kept.warnings
    for part in (
        "folder: 2 (dir.jpg)",
        "link to nothing: 1 (999.JPG)",
        "empty file: 1 (empty.png)",
        "file of another kind: 2 (notes.txt)",
        "thumbnail: 2 (img1_thumb.png)",
    ):
        assert part in note


def test_as_many_thumbnails_as_photos(tmp_path: Path) -> None:
    folder = photos_in(tmp_path / "photos", 6)
    for i in range(6):
        write_thumbnail(folder / f"a_thumb{i}.jpg")
    photos, (note,) = list_photos(folder)
    assert len(photos) == 6
    assert "thumbnail: 6" in note


def test_one_panorama_makes_no_thumbnails_of_photos(tmp_path: Path) -> None:
    folder = photos_in(tmp_path / "photos", 6)
    rng = np.random.default_rng(0)
    panorama = rng.integers(0, 255, (400, 1500), dtype=np.uint8)
    cv2.imwrite(str(folder / "pano.jpg"), panorama)
    photos, _ = list_photos(folder)
    assert len(photos) == 7
    with pytest.raises(BadInputError, match="1500x400"):
        list(open_recording(folder).frames())


def test_photos_of_one_size_are_never_thumbnails(tmp_path: Path) -> None:
    folder = photos_in(tmp_path / "photos")
    cv2.imwrite(str(folder / "img5.jpg"), np.full((240, 320), 90, np.uint8))
    photos, notes = list_photos(folder)
    assert len(photos) == 5
    assert notes == []


def test_a_folder_of_leavings_alone_is_refused(tmp_path: Path) -> None:
    (tmp_path / "dir.jpg").mkdir()
    with pytest.raises(BadInputError, match="no photos in this folder"):
        open_recording(tmp_path)
    with pytest.raises(BadInputError, match="no photos in this folder"):
        read_telemetry(tmp_path)


def test_further_pages_of_tiff_are_noted(tmp_path: Path) -> None:
    folder = photos_in(tmp_path / "photos", suffix=".tif")
    cv2.imwritemulti(str(folder / "img2.tif"), pan([20.0, 21.0, 22.0]))
    (note,) = open_recording(folder).warnings
    assert "first page of 1 TIFF files" in note
    assert "3 of img2.tif" in note
    assert len(TiffPages.of(folder / "img1.tif")) == 1


@pytest.mark.parametrize("deep", [False, True])
@pytest.mark.parametrize("alone", [False, True])
def test_the_pages_of_one_tiff_are_a_video(tmp_path: Path, deep: bool, alone: bool) -> None:
    images = pan([5.0 * i for i in range(12)])
    stack = np.stack(images).astype(np.uint16) * 5 + 29_000 if deep else np.stack(images)
    path = tmp_path / f"{LATIN_1}.tif"
    with path.open("wb") as file, tifffile.TiffWriter(file) as writer:
        for image in stack:
            writer.write(image, photometric="minisblack")
        writer.write(stack[0][::2, ::2], photometric="minisblack")
    recording = open_recording(tmp_path if alone else path)
    assert recording.is_video
    shown = list(recording.frames())
    assert len(shown) == len(images)
    assert (recording.stretch is not None) == deep
    for frame, image in zip(shown, images, strict=True):
        assert np.corrcoef(frame.image.ravel(), image.ravel())[0, 1] > 0.999
    kept = select_frames(recording, tmp_path / "frames")
    assert any("its 13 pages are read as a video of 25 frames" in note for note in kept.warnings)
    assert any("1 pages of" in note for note in kept.warnings)


def test_pages_that_are_not_wanted_are_not_decoded(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    images = pan([5.0 * i for i in range(12)])
    path = tmp_path / "a.tif"
    with tifffile.TiffWriter(path) as writer:
        for image in (images[0], images[0][::2, ::2], *images[1:]):
            writer.write(image, photometric="minisblack")
    recording = open_recording(path)
    decode, decoded = cv2.imdecode, []
    monkeypatch.setattr(cv2, "imdecode", lambda *given: decoded.append(1) or decode(*given))
    frames = list(recording.frames(lambda index, _: index in (1, 2, 7)))
    assert [frame.index for frame in frames] == [2, 7]
    for frame in frames:
        np.testing.assert_array_equal(frame.image, images[frame.index - 1])
    assert len(decoded) == 3


def test_pages_of_damaged_and_circular_tiff_files_are_counted_in_finite_time(
    tmp_path: Path,
) -> None:
    path = tmp_path / "a.tif"
    path.write_bytes(b"II*\0" + struct.pack("<IHI", 8, 0, 8))
    assert len(TiffPages.of(path)) == 1
    path.write_bytes(b"II*\0" + struct.pack("<IHIHI", 8, 0, 14, 0, 8))
    assert len(TiffPages.of(path)) == 2
    path.write_bytes(b"II*\0" + struct.pack("<I", 10_000))
    assert len(TiffPages.of(path)) == 0
    path.write_bytes(b"MM\0+" + struct.pack(">HHQQQ", 8, 0, 16, 0, 0))
    assert len(TiffPages.of(path)) == 1


@pytest.mark.parametrize("wide", [False, True])
def test_every_page_of_a_long_tiff_is_read_in_its_order(tmp_path: Path, wide: bool) -> None:
    path = tmp_path / "a.tif"
    pages = np.arange(3000, dtype=np.uint16)[:, None, None] + np.zeros((2, 2), np.uint16)
    with tifffile.TiffWriter(path, bigtiff=wide) as writer:
        for page in pages:
            writer.write(page, photometric="minisblack", metadata=None)
    shown = [int(image.load()[0, 0]) for image in TiffStack(path).read([])]
    assert len(shown) == 3000
    assert sorted(shown) == shown
    assert len(set(shown)) > 100


def test_photos_with_names_that_are_not_utf_8(tmp_path: Path) -> None:
    folder = photos_in(tmp_path / "photos").rename(tmp_path / LATIN_1)
    (folder / "img1.jpg").rename(folder / f"{LATIN_1}.jpg")
    (folder / LATIN_1).mkdir()
    kept = select_frames(open_recording(folder), tmp_path / "frames")
    kept.save(tmp_path / "index.json")
    assert KeyFrames.load(tmp_path / "index.json") == kept
    assert kept.frames[0].source == f"{LATIN_1}.jpg"
    assert [printable(note) for note in kept.warnings] == [
        r"caf\xe9: entries that are no photos were skipped; folder: 1 (caf\xe9)"
    ]
    assert len(fingerprint_path(folder)) == 64


def test_names_that_are_not_utf_8_are_stored_and_told_readably(tmp_path: Path) -> None:
    path = tmp_path / f"{LATIN_1}.mkv"
    settings = RunConfig(recording=path).to_plain()
    assert settings["recording"].encode().endswith(rb"/caf\xe9.mkv")
    with pytest.raises(BadInputError) as caught:
        open_recording(path)
    assert rb"caf\xe9.mkv: no such file" in str(caught.value).encode()
    assert printable("café.mkv") == "café.mkv"


def test_a_pipe_is_refused_and_not_waited_for(tmp_path: Path) -> None:
    pipe = tmp_path / "a.mp4"
    os.mkfifo(pipe)
    for read in (open_recording, fingerprint_path):
        with pytest.raises(BadInputError, match=r"a\.mp4: a pipe or a device"):
            read(pipe)


@pytest.mark.parametrize("shape", [(1, 1), (7, 64), (64, 7), (8, 257)])
def test_frames_of_which_nothing_is_left_when_shrunk_are_refused(
    tmp_path: Path, shape: tuple[int, int]
) -> None:
    for number in range(3):
        texture = np.random.default_rng(number).integers(0, 256, shape, dtype=np.uint8)
        cv2.imwrite(str(tmp_path / f"{number}.png"), texture)
    with pytest.raises(BadInputError, match=f"frames of {shape[1]}x{shape[0]} px"):
        open_recording(tmp_path)
