"""Waves in an image: found by its spectrum, mixed down, smoothed."""

import cv2
import numpy as np
import scipy.fft
from numpy.typing import NDArray

from geometry.arrays import FloatArray, FloatMap

LONGEST_PERIOD_PX, SHORTEST_PERIOD_PX = 28.0, 2.5
NOISE_ABOVE = 0.25
CROSSING = 0.5
SECOND_WAVE = 0.25

ComplexMap = NDArray[np.complex64]


def find_strongest_waves(flat: FloatMap, lattice: FloatMap) -> tuple[FloatArray, float]:
    """(Q, 2) cycles per longer side, along x and y, of one or two waves; the noise, grey levels."""
    height, width = flat.shape
    window = np.outer(np.hanning(height), np.hanning(width)).astype(np.float32) * lattice
    power = np.abs(scipy.fft.rfft2(flat * window)) ** 2
    x, y = np.meshgrid(np.fft.rfftfreq(width), np.fft.fftfreq(height))
    frequency = np.hypot(x, y)
    noise = np.median(power[frequency > NOISE_ABOVE]) / np.log(2) / (window**2).sum()
    power *= (frequency > 1 / LONGEST_PERIOD_PX) & (frequency < 1 / SHORTEST_PERIOD_PX)
    strongest = power.max()
    waves: list[FloatArray] = []
    while len(waves) < 2 and power.max() >= SECOND_WAVE**2 * strongest:
        place = np.unravel_index(power.argmax(), power.shape)
        wave = np.array([x[place], y[place]])
        waves.append(wave * max(flat.shape))
        power *= np.abs(wave[0] * y - wave[1] * x) > CROSSING * np.hypot(*wave) * frequency
    return np.array(waves), float(np.sqrt(noise))


def pixel_positions(shape: tuple[int, ...], step: int) -> tuple[FloatMap, FloatMap]:
    """(1, W) and (H, 1) of every pixel, or of the middles of every 2 x 2."""
    down, across = (
        ((np.arange(0, n, step) + (step - 1) / 2 - (n - 1) / 2) / max(shape)).astype(np.float32)
        for n in shape
    )
    return across[None], down[:, None]


def unit_phasors(phase: np.ndarray) -> ComplexMap:
    """EdgePoints on the unit circle, e^(i phase)."""
    phase = phase.astype(np.float32)
    phasors = np.empty(phase.shape, np.complex64)
    phasors.real, phasors.imag = np.cos(phase), np.sin(phase)
    return phasors


def halve_image(image: FloatMap) -> FloatMap:
    """The means of every 2 x 2."""
    height, width = image.shape[:2]
    size = (width // 2, height // 2)
    return np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA))


def smooth_halved(mixed: ComplexMap, window_px: float) -> ComplexMap:
    """At half resolution, under a Gaussian window; beyond the edge there is nothing."""
    planes = halve_image(np.ascontiguousarray(mixed).view(np.float32).reshape(*mixed.shape, 2))
    planes = cv2.GaussianBlur(planes, (0, 0), window_px / 2, borderType=cv2.BORDER_CONSTANT)
    smooth: ComplexMap = np.ascontiguousarray(planes).view(np.complex64)[..., 0]
    return smooth
