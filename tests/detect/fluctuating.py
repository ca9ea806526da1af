"""Frames by a camera at rest, of a textured wall, with air moving before part of it."""

import cv2
import numpy as np

from detect.warp import pixel_grid, sample
from geometry.arrays import BoolArray, GreyImage

SHAPE = (120, 160)
PERIOD, AXIS_PX = 12.0, 102


def plume() -> BoolArray:
    """(H, W) where the air moves."""
    mask = np.zeros(SHAPE, np.uint8)
    cv2.rectangle(mask, (90, 20), (114, 90), 1, -1)
    return np.asarray(mask > 0)


def frames(
    amplitude_px: float,
    *,
    count: int = 60,
    noise: float = 2.0,
    held: int = 1,
    springs: bool = False,
    seed: int = 0,
) -> list[GreyImage]:
    """Light is bent to both sides of an axis before part of a wall.

    Args:
        amplitude_px: Of a sine, or times sqrt(2) the standard deviation of what never repeats.
        count: Of frames.
        noise: Standard deviation, grey levels.
        held: Noise is renewed every so many frames.
        springs: It swings to and fro in place, instead of travelling up without repeating.
        seed: Of everything random.
    """
    rng = np.random.default_rng(seed)
    wall = cv2.GaussianBlur(rng.normal(size=SHAPE), (0, 0), 1.2)
    wall = (128 + 30 * wall / wall.std()).astype(np.float32)
    eddies = cv2.GaussianBlur(rng.normal(size=(1, 600)), (0, 0), 5.0)[0]
    eddies *= np.sqrt(0.5) / eddies.std()
    grid = pixel_grid(SHAPE)
    y = grid[..., 1]
    side = np.where(plume(), np.sign(grid[..., 0] - AXIS_PX), 0)
    images = []
    for t in range(count):
        if t % held == 0:
            grain = rng.normal(scale=noise, size=SHAPE)
        swing = np.sin(2 * np.pi * (y / 20 + t / PERIOD))
        wave = amplitude_px * side * (swing if springs else eddies[(y + 3 * t).astype(int)])
        seen = sample(wall, grid + np.stack([wave, 0 * wave], axis=-1).astype(np.float32))
        images.append(np.clip(np.rint(seen + grain), 0, 255).astype(np.uint8))
    return images
