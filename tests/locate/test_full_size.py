"""Frames are kept at full size beside those that poses are found in."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from detect.warp import pixel_grid
from geometry.camera import Camera
from geometry.errors import BadInputError
from locate.pipeline.map_notes import full_size_notes
from locate.recording import KeyFrames, open_recording, select_frames
from locate.recording.images import FullSizeImages

HEIGHT, WIDTH = 120, 200
MOVE_PX = 6


def write_photos(folder: Path, *, move_px: int = MOVE_PX) -> Path:
    random = np.random.default_rng(0).random((HEIGHT, 2 * WIDTH))
    smooth = cv2.GaussianBlur(random, (0, 0), 1.5)
    texture = np.uint8(40 + 170 * (smooth - smooth.min()) / np.ptp(smooth))
    folder.mkdir()
    for i in range(5):
        crop = texture[:, move_px * i : move_px * i + WIDTH]
        assert cv2.imwrite(str(folder / f"{i}.png"), crop)
    return folder


def select(tmp_path: Path, *, max_side: int, full_side: int, move_px: int = MOVE_PX) -> KeyFrames:
    photos = write_photos(tmp_path / "photos", move_px=move_px)
    recording = open_recording(photos, max_side=max_side, full_side=full_side)
    return select_frames(recording, tmp_path / "frames")


def read(path: Path) -> np.ndarray:
    return np.asarray(cv2.imread(str(path), cv2.IMREAD_UNCHANGED))


def test_pixels_as_recorded_stand_beside_the_frames(tmp_path: Path) -> None:
    kept = select(tmp_path, max_side=100, full_side=WIDTH)
    assert (kept.width, kept.height) == (100, 60)
    assert kept.full_size == (WIDTH, HEIGHT)
    for frame in kept.frames:
        assert read(tmp_path / "frames" / frame.name).shape == (60, 100)
        stored = read(tmp_path / "frames" / "full" / frame.name)
        np.testing.assert_array_equal(stored, read(tmp_path / "photos" / frame.source))
    (note,) = full_size_notes(kept)
    assert "200x120 px" in note
    assert "100x60 px" in note


def test_what_is_reduced_to_the_cap_is_not_rounded_to_grey_levels(tmp_path: Path) -> None:
    kept = select(tmp_path, max_side=50, full_side=100)
    frame = kept.frames[0]
    whole = read(tmp_path / "photos" / frame.source).astype(float)
    exact = whole.reshape(60, 2, 100, 2).mean(axis=(1, 3))
    images = FullSizeImages(
        [tmp_path / "frames" / "full" / frame.name], Camera.pinhole(50, 30, 60.0), (100, 60)
    )
    np.testing.assert_allclose(images[0], exact, atol=0.5 / 256)


@pytest.mark.parametrize(("side", "move_px"), [(WIDTH, MOVE_PX), (100, 0)])
def test_nothing_is_kept_twice_and_nothing_of_a_camera_at_rest(
    tmp_path: Path, side: int, move_px: int
) -> None:
    kept = select(tmp_path, max_side=side, full_side=WIDTH, move_px=move_px)
    assert kept.static is (move_px == 0)
    assert kept.full_size is None
    assert not (tmp_path / "frames" / "full").exists()
    assert full_size_notes(kept) == ()


def test_a_full_size_frame_shows_what_the_pinhole_would_have_seen(tmp_path: Path) -> None:
    lens = Camera(model="SIMPLE_RADIAL", width=160, height=120, params=(140, 79.5, 59.5, -0.08))
    large = lens.scaled(2)

    def waves(positions: np.ndarray) -> np.ndarray:
        return 128 + 50 * np.sin(positions[..., 0] / 3.2) + 50 * np.cos(positions[..., 1] / 3.4)

    grid = pixel_grid((240, 320))
    seen = large.undistorted().project(large.rays(grid))
    cv2.imwrite(str(tmp_path / "a.png"), np.rint(waves(seen)))
    image = FullSizeImages([tmp_path / "a.png"], lens, (320, 240))[0]
    inside = np.s_[30:-30, 30:-30]
    assert np.abs(image - waves(grid))[inside].mean() < 1.0
    assert np.abs(read(tmp_path / "a.png") - waves(grid))[inside].mean() > 8.0


def test_a_lost_frame_is_named(tmp_path: Path) -> None:
    images = FullSizeImages([tmp_path / "lost.png"], Camera.pinhole(8, 6, 9.0), (16, 12))
    with pytest.raises(BadInputError, match=r"lost\.png: is gone"):
        images[0]
