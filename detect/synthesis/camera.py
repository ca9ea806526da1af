"""How a camera forms an image of a displaced background, without a trace of interpolation."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from detect.warp import pixel_grid
from geometry.arrays import FloatArray, FloatMap, GreyImage

Background = Callable[[FloatMap, FloatMap], FloatMap]
"""Radiance, 0 to 1, at any positions x, y in px of the frame."""

OVERSAMPLING = 4
MARGIN_PX = 3
"""What the lens blur needs to know beyond the frame."""
STILL_PX = 2e-4
WHITE = 255.0


@dataclass(frozen=True, kw_only=True)
class CameraOptics:
    """The camera of one sample.

    Attributes:
        psf_sigma_px: Gaussian blur of the lens.
        noise: Standard deviation of the sensor noise, grey levels of 255, before the tone curve.
        gamma: Exponent of the tone curve.
        jpeg_quality: 1 to 100; None leaves the image uncompressed.
    """

    psf_sigma_px: float = 0.45
    noise: float = 0.0
    gamma: float = 1.0
    jpeg_quality: int | None = None


def expose_background(
    background: Background,
    warps: Sequence[FloatMap],
    shift_px: FloatArray,
    optics: CameraOptics,
    rng: np.random.Generator,
) -> GreyImage:
    """Light gathered over the exposure, lens blur, pixel area, noise, tone curve, 8 bit, JPEG.

    Pixel p shows the background at p + w(p) + shift.

    Args:
        background: Evaluated at 4 x 4 positions per pixel, wherever the warps lead.
        warps: Displacements w during the exposure, each (H + 2 MARGIN_PX, W + 2 MARGIN_PX, 2), px.
        shift_px: (2,) one more displacement, the same for every pixel.
        optics: The camera.
        rng: Draws the noise.

    Returns:
        (H, W) grey values.
    """
    light = _gather_light(background, warps, shift_px)
    light = cv2.GaussianBlur(light, (0, 0), optics.psf_sigma_px * OVERSAMPLING)
    trim = slice(MARGIN_PX * OVERSAMPLING, -MARGIN_PX * OVERSAMPLING)
    shrink = 1 / OVERSAMPLING
    pixels = cv2.resize(light[trim, trim], None, fx=shrink, fy=shrink, interpolation=cv2.INTER_AREA)
    noisy = pixels + optics.noise / WHITE * rng.standard_normal(pixels.shape, dtype=np.float32)
    toned = WHITE * np.clip(noisy, 0, 1) ** optics.gamma
    image: GreyImage = np.rint(toned).astype(np.uint8)
    return image if optics.jpeg_quality is None else _compress_jpeg(image, optics.jpeg_quality)


def _gather_light(
    background: Background, warps: Sequence[FloatMap], shift_px: FloatArray
) -> FloatMap:
    """Mean radiance over the moments; what did not move since the first is not seen anew."""
    x, y = _fine_positions(warps[0], shift_px)
    light = background(x, y)
    change = np.zeros_like(light)
    for warp in warps[1:]:
        moved = np.abs(warp - warps[0]).max(axis=-1) > STILL_PX
        if moved.any():
            part = tuple(
                slice(max(at.min() - 1, 0) * OVERSAMPLING, (at.max() + 2) * OVERSAMPLING)
                for at in np.nonzero(moved)
            )
            x, y = _fine_positions(warp, shift_px)
            change[part] += background(x[part], y[part]) - light[part]
    return np.asarray(light + change / np.float32(len(warps)))


def _fine_positions(warp: FloatMap, shift_px: FloatArray) -> tuple[FloatMap, FloatMap]:
    """Where each of the 4 x 4 parts of every pixel looks."""
    height, width = warp.shape[0] * OVERSAMPLING, warp.shape[1] * OVERSAMPLING
    fine = np.asarray(cv2.resize(warp, (width, height), interpolation=cv2.INTER_LINEAR))
    middles = [(np.arange(n) + 0.5) / OVERSAMPLING - 0.5 - MARGIN_PX for n in (width, height)]
    x, y = ((at + s).astype(np.float32) for at, s in zip(middles, shift_px, strict=True))
    return fine[..., 0] + x, fine[..., 1] + y[:, None]


def _compress_jpeg(image: GreyImage, quality: int) -> GreyImage:
    _, data = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, quality])
    return np.asarray(cv2.imdecode(data, cv2.IMREAD_GRAYSCALE), dtype=np.uint8)


def naive_warp(image: GreyImage, displacement: FloatMap) -> GreyImage:
    """The bilinear software warp of an image that was already taken. It leaks.

    What it interpolates it also blurs, and the blur shows where the warp was. It is here so
    that a test can show it; no training data may come from it.

    Args:
        image: (H, W) grey values.
        displacement: (H, W, 2) px.
    """
    positions = pixel_grid(image.shape) + displacement
    return np.asarray(
        cv2.remap(image, positions, None, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REFLECT_101),
        dtype=np.uint8,
    )
