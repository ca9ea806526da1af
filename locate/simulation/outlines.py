"""Outlines of what is cut out of a photo: solid where positive."""

import cv2
import numpy as np

from geometry.arrays import FloatMap

OUTLINE_PX = 192


def bush_outline(rng: np.random.Generator) -> FloatMap:
    """Ragged, with holes, thinner outwards."""
    ragged = 0.9 * _smooth_noise(rng, rng.uniform(1.5, 4)) + 0.4 * _smooth_noise(rng, 14)
    return np.asarray(_radial_envelope(1.2) + ragged, dtype=np.float32)


def patch_outline(rng: np.random.Generator) -> FloatMap:
    """One smooth patch."""
    return _radial_envelope(1.0) + 0.5 * _smooth_noise(rng, 18)


def person_outline(rng: np.random.Generator) -> FloatMap:
    """Someone standing: head, trunk, arms and two legs in mid-stride."""
    drawn = np.zeros((OUTLINE_PX, OUTLINE_PX), np.uint8)
    middle, stride = OUTLINE_PX // 2, int(rng.integers(8, 45))
    cv2.circle(drawn, (middle, 16), 14, 255, -1)
    cv2.ellipse(drawn, (middle, 72), (36, 48), 0, 0, 360, 255, -1)
    for side in (-1, 1):
        foot = (middle + side * stride, OUTLINE_PX - 3)
        cv2.line(drawn, (middle + side * 10, 105), foot, 255, 22)
        hand = (middle + side * (34 + stride // 2), 112)
        cv2.line(drawn, (middle + side * 28, 48), hand, 255, 14)
    soft = cv2.GaussianBlur(drawn.astype(np.float32) / 255, (0, 0), 1.5)
    return np.asarray(soft - 0.5)


def _smooth_noise(rng: np.random.Generator, grain_px: float) -> FloatMap:
    noise = rng.standard_normal((OUTLINE_PX, OUTLINE_PX), dtype=np.float32)
    smooth = cv2.GaussianBlur(noise, (0, 0), grain_px)
    return np.asarray(smooth / smooth.std())


def _radial_envelope(height: float) -> FloatMap:
    """Falls from `height` in the middle to about -2 at the rim."""
    side = np.linspace(-1, 1, OUTLINE_PX, dtype=np.float32)
    return np.asarray(height - (height + 2) * (side[:, None] ** 2 + side**2))
