"""Frames in colour, to be looked at: of videos, photos and what has none."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from geometry.arrays import Picture
from geometry.camera import Camera
from locate.recording import open_recording
from locate.recording.colours import undistorted_pictures
from locate.recording.posed_frames import PosedFrames
from locate.recording.recording import Recording
from locate.recording.writer import create_video

COLOURS = np.array([[40, 60, 200], [40, 200, 60], [200, 60, 40], [30, 160, 180]])
ROWS = (0, 2, 3)


def coloured(row: int) -> Picture:
    """A frame in a colour of its own."""
    return np.full((48, 64, 3), COLOURS[row], dtype=np.uint8)


def posed(folder: Path, recording: Recording, camera: Camera | None = None) -> PosedFrames:
    """The frames as a run keeps them: grey files."""
    frames = list(recording.frames())
    folder.mkdir()
    for frame in frames:
        cv2.imwrite(str(folder / f"{frame.index:06d}.png"), frame.image)
    return PosedFrames(
        folder=folder,
        names=[f"{frame.index:06d}.png" for frame in frames],
        indices=np.array([frame.index for frame in frames]),
        camera=camera or Camera.pinhole(64, 48, 60.0),
    )


def write_video(path: Path) -> None:
    with create_video(path, size=(64, 48), fps=10) as video:
        for row in range(len(COLOURS)):
            video.write(coloured(row))


def write_photos(path: Path) -> None:
    path.mkdir()
    for row in range(len(COLOURS)):
        cv2.imwrite(str(path / f"{row}.png"), coloured(row))


@pytest.mark.parametrize(("name", "write"), [("film.mp4", write_video), ("photos", write_photos)])
def test_frames_have_the_colours_that_were_filmed(tmp_path: Path, name: str, write) -> None:
    write(tmp_path / name)
    recording = open_recording(tmp_path / name)
    frames = posed(tmp_path / "frames", recording)
    shown = list(undistorted_pictures(recording, frames, ROWS, np.arange(4) / 10))
    assert [row for row, _ in shown] == list(ROWS)
    for row, picture in shown:
        assert picture.shape == (48, 64, 3)
        np.testing.assert_allclose(picture.mean(axis=(0, 1)), COLOURS[row], atol=12)


def test_frames_of_16_bits_stay_grey(tmp_path: Path) -> None:
    photos = tmp_path / "photos"
    photos.mkdir()
    ramp = np.linspace(9_000, 11_000, 48 * 64).reshape(48, 64).astype(np.uint16)
    for row in range(3):
        cv2.imwrite(str(photos / f"{row}.png"), ramp)
    recording = open_recording(photos)
    frames = posed(tmp_path / "frames", recording)
    ((_, picture),) = undistorted_pictures(recording, frames, [1], np.arange(3.0))
    grey = cv2.imread(str(tmp_path / "frames" / "000001.png"), cv2.IMREAD_GRAYSCALE)
    np.testing.assert_array_equal(picture, np.repeat(grey[..., None], 3, axis=2))


def test_colour_is_undistorted_as_the_grey_frame_is(tmp_path: Path) -> None:
    photos = tmp_path / "photos"
    photos.mkdir()
    image = np.zeros((48, 64, 3), np.uint8)
    image[:, ::8], image[::8] = 255, 255
    for row in range(3):
        cv2.imwrite(str(photos / f"{row}.png"), image)
    recording = open_recording(photos)
    bent = Camera(model="SIMPLE_RADIAL", width=64, height=48, params=(60.0, 31.5, 23.5, -0.3))
    frames = posed(tmp_path / "frames", recording, bent)
    ((row, picture),) = undistorted_pictures(recording, frames, [1], np.arange(3.0))
    difference = picture.mean(axis=2) - frames.undistorted().images[row]
    assert (
        np.abs(difference).mean() < 0.1 * np.abs(image.mean(axis=2) - picture.mean(axis=2)).mean()
    )
