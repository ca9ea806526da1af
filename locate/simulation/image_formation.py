"""From radiance to the grey values that a camera stores."""

import cv2
import numpy as np

from geometry.arrays import FloatMap, GreyImage
from locate.simulation.scene import ImageBlock

GAMMA = 2.2


def expose_image(radiance: FloatMap, image: ImageBlock, rng: np.random.Generator) -> GreyImage:
    """Lens blur, pixel area, tone curve, noise, 8 bit.

    Args:
        radiance: (H * samples, W * samples), linear, 1 is white.
        image: How the camera forms images.
        rng: Draws the noise.

    Returns:
        (H, W) grey values.
    """
    if image.psf_sigma_px:
        radiance = cv2.GaussianBlur(radiance, (0, 0), image.psf_sigma_px * image.samples)
    light = np.clip(area_mean(radiance, image.samples) * image.gain, 0, None)
    return digitise_grey(255 * light ** (1 / GAMMA), image, rng)


def digitise_grey(grey: FloatMap, image: ImageBlock, rng: np.random.Generator) -> GreyImage:
    """Adds sensor noise to grey values of 0 to 255, and rounds to 8 bit."""
    noisy = grey + image.noise * rng.standard_normal(grey.shape, dtype=np.float32)
    return np.asarray(np.clip(np.rint(noisy), 0, 255), dtype=np.uint8)


def area_mean(fine: FloatMap, samples: int) -> FloatMap:
    """(H, W, ...) mean of each block of samples x samples of a finer (H * s, W * s, ...) map."""
    size = (fine.shape[1] // samples, fine.shape[0] // samples)
    return np.asarray(cv2.resize(fine, size, interpolation=cv2.INTER_AREA), dtype=np.float32)
