from pathlib import Path

import cv2
import numpy as np
import pytest

from geometry.camera import Camera
from geometry.errors import BadInputError
from locate.recording.images import FrameImages, distortion_map


def waves(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    return 128 + 50 * np.sin(x / 1.6) + 50 * np.cos(y / 1.7 + x / 40)


def test_undistorted_frame_shows_what_the_pinhole_would_have_seen(tmp_path: Path) -> None:
    lens = Camera(model="SIMPLE_RADIAL", width=160, height=120, params=(140, 79.5, 59.5, -0.08))
    grid = lens.pixel_grid().astype(float)
    rays = lens.rays(grid)
    seen = lens.undistorted().project(rays)
    cv2.imwrite(str(tmp_path / "a.png"), np.rint(waves(seen[..., 0], seen[..., 1])))
    image = FrameImages([tmp_path / "a.png"], lens)[0].astype(float)
    inside = np.s_[15:-15, 15:-15]
    expected = waves(grid[..., 0], grid[..., 1])
    assert np.abs(image - expected)[inside].mean() < 2.0
    raw = FrameImages([tmp_path / "a.png"])[0].astype(float)
    assert np.abs(raw - expected)[inside].mean() > 8.0


def test_harmless_lens_leaves_the_pixels_alone() -> None:
    assert distortion_map(Camera.pinhole(64, 48, 60)) is None
    tiny = Camera(model="SIMPLE_RADIAL", width=64, height=48, params=(60, 31.5, 23.5, -1e-5))
    assert distortion_map(tiny) is None


def test_lost_frame_is_named(tmp_path: Path) -> None:
    with pytest.raises(BadInputError, match=r"lost\.png"):
        FrameImages([tmp_path / "lost.png"])[0]
