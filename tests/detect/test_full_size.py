"""What frames tell at their full size, where poses and depth are of a smaller one."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from detect.information import MAP_WIDTH_PX, DisplacementInformation
from detect.registered import RegisteredDetector, full_size
from detect.registered.full_size import FullSizeFrames
from detect.registered.information import COMMON_SHARE
from detect.warp import pixel_grid, sample
from tests.detect.scenes import two_walls

HEIGHT, WIDTH = 192, 640
COUNT = 6


def column_turn(size_px: float) -> np.ndarray:
    """(H, W, 2) what an upright column of that strength displaces."""
    x = (np.arange(WIDTH) - WIDTH / 2) / 24
    turn = np.zeros((HEIGHT, WIDTH, 2), np.float32)
    turn[..., 0] = size_px * x * np.exp(-(x**2) / 2)
    return turn


def filmed(
    *, turn_px: float, finest_px: float, factor: float, move_px: float = 0.0
) -> FullSizeFrames:
    """A key frame with a turn, and neighbours that move by more each, measured `factor` smaller."""
    rng = np.random.default_rng(3)
    white = rng.normal(size=(HEIGHT, WIDTH))
    texture = cv2.GaussianBlur(white, (0, 0), finest_px)
    texture = (127 + 25 * texture / texture.std()).astype(np.float32)
    grid = pixel_grid((HEIGHT, WIDTH))
    steps = np.arange(1, COUNT + 1)[:, None] * np.array([move_px, 0.5 * move_px], np.float32)
    images = [sample(texture, grid + column_turn(turn_px))]
    images += [sample(texture, grid - step) for step in steps]
    noisy = [(image + rng.normal(size=image.shape)).astype(np.float32) for image in images]
    small = (round(HEIGHT / factor), round(WIDTH / factor))
    slopes = np.zeros((COUNT, 2, *small), np.float32)
    slopes[:, 0] = np.linspace(-20, 20, COUNT)[:, None, None]
    flows = np.empty_like(slopes)
    flows[:] = (steps / factor)[:, :, None, None]
    return FullSizeFrames(
        images=noisy, flows=flows, slopes=slopes, depth_edge_px=np.zeros(small, np.float32)
    )


def strength_px(information: DisplacementInformation) -> float:
    """Of the column's turn, by least squares, both without what surroundings share."""
    height, width = information.matrix.shape[:2]
    shape = cv2.resize(column_turn(1.0), (width, height), interpolation=cv2.INTER_AREA)
    exact = DisplacementInformation(
        vector=information.times(shape), matrix=information.matrix
    ).without_local_mean(COMMON_SHARE * width)
    return float((shape * information.vector).sum() / (shape * exact.vector).sum())


def test_frames_that_are_no_larger_tell_the_same() -> None:
    scene = two_walls(peak_px=0.15)
    usual = RegisteredDetector().detect(scene.frames, scene.key).information
    floats = [image.astype(np.float32) for image in scene.frames.images]
    full = RegisteredDetector().detect(replace(scene.frames, full_size=floats), scene.key)
    assert usual is not None
    assert full.information is not None
    for name in ("vector", "matrix"):
        mine, others = getattr(full.information, name), getattr(usual, name)
        np.testing.assert_allclose(mine, others, atol=0.01 * np.abs(others).max())


@pytest.mark.parametrize("factor", [1.0, 1.5, 2.0])
@pytest.mark.parametrize("move_px", [0.0, 1.7])
def test_displacement_counts_in_px_of_the_smaller_frame(factor: float, move_px: float) -> None:
    frames = filmed(turn_px=0.3, finest_px=0.9, factor=factor, move_px=move_px)
    information = frames.measure()
    assert information.matrix.shape[1] == MAP_WIDTH_PX
    assert strength_px(information) == pytest.approx(0.3 / factor, rel=0.15)


def test_strips_do_not_show(monkeypatch: pytest.MonkeyPatch) -> None:
    frames = filmed(turn_px=0.3, finest_px=0.9, factor=1.5, move_px=1.7)
    at_once = frames.measure()
    monkeypatch.setattr(full_size, "STRIP_PIXELS", WIDTH * 50)
    in_strips = frames.measure()
    largest = np.abs(at_once.vector).max()
    np.testing.assert_allclose(in_strips.vector, at_once.vector, atol=1e-3 * largest)


@pytest.mark.parametrize(("finest_px", "halvings"), [(0.9, 0), (3.0, 1)])
def test_frames_without_detail_at_their_size_are_measured_at_half_of_it(
    finest_px: float, halvings: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    frames = filmed(turn_px=0.3, finest_px=finest_px, factor=2.0)
    assert frames.count_halvings() == halvings
    at_once = strength_px(frames.measure())
    assert at_once == pytest.approx(0.15, rel=0.15)
    monkeypatch.setattr(full_size, "STRIP_PIXELS", WIDTH * 50)
    assert strength_px(frames.measure()) == pytest.approx(at_once, rel=1e-3)
