"""A camera's shaking is taken out, and haze is told from it and from the noise of codecs."""

import cv2
import numpy as np
import pytest

from detect.fluctuation import shifts_px
from detect.haze import Haze, measure_haze
from detect.steady import SteadyImages
from detect.warp import pixel_grid, sample
from geometry.arrays import FloatMap, GreyImage

SHAPE = (180, 240)
COUNT = 24
NEAR_ROW, NEAR_COLUMN = 110, 80


def eddies(rng: np.random.Generator) -> FloatMap:
    """(2, H, W) displacement that varies over some 14 px, of 1 px rms in all."""
    field = np.stack([cv2.GaussianBlur(rng.normal(size=SHAPE), (0, 0), 7.0) for _ in range(2)])
    return np.asarray(field / field.std() / np.sqrt(2), dtype=np.float32)


def recording(
    *,
    haze_px: float = 0.0,
    shaking_px: float = 0.0,
    near: float = 0.0,
    held: int = 1,
    seed: int = 0,
) -> list[GreyImage]:
    """Frames of a textured wall.

    Args:
        haze_px: Root mean square of the displacement by the air, in the lower half twice as much
            as in the upper.
        shaking_px: Standard deviation of each component of the camera's motion, which also turns.
        near: By what share what stands nearer, at the lower left, moves more with the camera.
        held: Noise is renewed every so many frames, as by a codec.
        seed: Of everything random.
    """
    rng = np.random.default_rng(seed)
    wall = cv2.GaussianBlur(rng.normal(size=SHAPE), (0, 0), 1.5)
    wall = (128 + 40 * wall / wall.std()).astype(np.float32)
    grid = pixel_grid(SHAPE)
    stronger = np.where(np.arange(SHAPE[0]) < SHAPE[0] / 2, 0.5, 1.0)[:, None]
    frames, grain = [], np.zeros(SHAPE)
    for t in range(COUNT):
        if t % held == 0:
            grain = rng.normal(scale=2.0, size=SHAPE)
        shift, turn = shaking_px * rng.normal(size=2), shaking_px * rng.normal() / 200
        about = grid - np.array(SHAPE[::-1]) / 2
        motion = shift + turn * np.stack([-about[..., 1], about[..., 0]], axis=-1)
        motion *= 1 + near * ((grid[..., 1:] > NEAR_ROW) & (grid[..., :1] < NEAR_COLUMN))
        air = np.moveaxis(haze_px * stronger * eddies(rng), 0, -1)
        seen = sample(wall, (grid + motion + air).astype(np.float32)) + grain
        frames.append(np.clip(np.rint(seen), 0, 255).astype(np.uint8))
    return frames


def rms(images: list[GreyImage]) -> float:
    return float(np.sqrt((shifts_px(images) ** 2).sum(axis=1).mean()))


def test_shaking_is_measured_and_taken_out() -> None:
    shaken, still = recording(shaking_px=0.6), recording()
    steady = SteadyImages(shaken)
    assert steady.shaking.rms_px == pytest.approx(0.6 * np.sqrt(2), rel=0.4)
    assert rms(list(steady)) < 1.5 * rms(still) < 0.5 * rms(shaken)


def test_what_does_not_shake_is_left_as_it_is() -> None:
    still = recording()
    steady = SteadyImages(still)
    assert steady.shaking.rms_px < 0.02
    assert all((a == b).all() for a, b in zip(steady, still, strict=True))


def test_what_stands_nearer_moves_more_and_is_still_taken_out() -> None:
    """It moves by 0.4 px more than the rest."""
    inside = np.s_[..., NEAR_ROW + 10 :, : NEAR_COLUMN - 10]
    shaken = recording(shaking_px=0.6, near=0.5)
    left = shifts_px(list(SteadyImages(shaken)))[inside]
    still = shifts_px(recording())[inside]
    assert np.sqrt((left**2).sum(axis=1).mean()) < 0.12 + np.sqrt((still**2).sum(axis=1).mean())


def test_a_part_of_steady_images_is_as_steady() -> None:
    steady = SteadyImages(recording(shaking_px=0.6))
    part = steady[4:9]
    assert len(part) == 5
    assert (part[2] == steady[6]).all()


def haze_of(images: list[GreyImage]) -> Haze | None:
    return measure_haze(SteadyImages(images))


def test_haze_is_measured_by_height() -> None:
    haze = haze_of(recording(haze_px=0.6, shaking_px=0.4))
    assert haze is not None
    assert 0.25 < haze.rms_px < 0.6
    top, *_, bottom = haze.by_height()
    assert top is not None
    assert bottom is not None
    assert bottom > 1.5 * top
    assert haze.largest_px >= bottom


@pytest.mark.parametrize("held", [1, 6])
@pytest.mark.parametrize("shaking_px", [0.0, 0.6])
def test_noise_and_shaking_are_no_haze(held: int, shaking_px: float) -> None:
    assert haze_of(recording(held=held, shaking_px=shaking_px)) is None


def test_few_frames_and_empty_ones_show_no_haze() -> None:
    assert haze_of(recording(haze_px=0.6)[:5]) is None
    assert haze_of([np.full(SHAPE, 90, np.uint8)] * 12) is None
