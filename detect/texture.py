"""What kind of texture an image shows where, by the image alone."""

from dataclasses import dataclass
from enum import IntEnum

import cv2
import numpy as np
import scipy.fft
from numpy.typing import NDArray

from geometry.arrays import FloatMap, GreyImage

WINDOW_PX, STEP_PX = 64, 48
LONGEST_PERIOD_PX, SHORTEST_PERIOD_PX = 28.0, 2.2
SLOWEST_NOISE = 0.25
PEAK_RADIUS = 3.1 / WINDOW_PX
CROSSING = 0.5
LEAST_CONTRAST = 1.5
EMPTY = 1e-6
LATTICE_SHARE = 0.75
STRAIGHT_SHARE = 0.7

HANN = np.outer(*[np.hanning(WINDOW_PX).astype(np.float32)] * 2)
FREQUENCY_X, FREQUENCY_Y = np.meshgrid(
    np.fft.rfftfreq(WINDOW_PX).astype(np.float32), np.fft.fftfreq(WINDOW_PX).astype(np.float32)
)
FREQUENCY = np.hypot(FREQUENCY_X, FREQUENCY_Y)
BAND = (FREQUENCY > 1 / LONGEST_PERIOD_PX) & (FREQUENCY < 1 / SHORTEST_PERIOD_PX)
NOISY = (FREQUENCY > SLOWEST_NOISE) & (FREQUENCY < 0.5)
COUNTED = np.where((FREQUENCY_X > 0) & (FREQUENCY_X < 0.5), 2, 1).ravel().astype(np.float32)
COUNTED /= WINDOW_PX**2 * (HANN**2).sum()
"""Weights that turn (64 x 33) powers of the half-plane into variance, grey levels squared."""
TURN = (FREQUENCY_X + 1j * FREQUENCY_Y).ravel() / np.maximum(FREQUENCY.ravel(), EMPTY)
STEEP = COUNTED * FREQUENCY.ravel() ** 2
MOMENTS = np.stack(
    [COUNTED, STEEP, *(STEEP * part for k in (2, 4) for part in ((TURN**k).real, (TURN**k).imag))],
    axis=-1,
).astype(np.float32)
"""Variance, squared gradient, and the latter by twice and four times its direction."""

Classes = NDArray[np.uint8]


class Texture(IntEnum):
    """What a single frame can measure depends on it."""

    FLAT = 0
    """No displacement can be measured."""
    LATTICE = 1
    """One or two waves hold nearly all of the contrast."""
    STRAIGHT = 2
    """Edges of one direction, or of two at right angles."""
    IRREGULAR = 3
    """Everything else; most of nature."""


@dataclass(frozen=True, kw_only=True)
class WindowSpectra:
    """Of W windows.

    Attributes:
        contrast: (W,) standard deviation above the noise, grey levels.
        periodic: (W,) share of the variance that the two strongest waves hold.
        straight: (W,) 0 where gradients point anywhere, 1 where they keep to one direction or to
            two at right angles.
    """

    contrast: FloatMap
    periodic: FloatMap
    straight: FloatMap


def texture_classes(image: GreyImage) -> Classes:
    """(H, W) of `Texture`, by the spectra of windows of 64 px.

    Args:
        image: (H, W) grey values.
    """
    height, width = image.shape
    starts = [_window_starts(side) for side in image.shape]
    padding = [(0, max(WINDOW_PX - side, 0)) for side in image.shape]
    padded = np.pad(image, padding, mode="reflect")
    every = np.lib.stride_tricks.sliding_window_view(padded, (WINDOW_PX, WINDOW_PX))
    windows = every[np.ix_(*starts)]
    spectra = window_spectra(windows.reshape(-1, WINDOW_PX, WINDOW_PX))
    contrast, periodic, straight = (
        _interpolate_windows(values.reshape(windows.shape[:2]), starts, (height, width))
        for values in (spectra.contrast, spectra.periodic, spectra.straight)
    )
    classes = np.full(image.shape, Texture.IRREGULAR, np.uint8)
    classes[straight > STRAIGHT_SHARE] = Texture.STRAIGHT
    classes[periodic > LATTICE_SHARE] = Texture.LATTICE
    classes[contrast < LEAST_CONTRAST] = Texture.FLAT
    return classes


def window_spectra(windows: NDArray[np.uint8]) -> WindowSpectra:
    """Measures (W, 64, 64) windows."""
    waves = windows.astype(np.float32)
    waves -= waves.mean(axis=(1, 2), keepdims=True)
    spectrum = scipy.fft.rfft2(waves * HANN)
    power = spectrum.real**2 + spectrum.imag**2
    noise = np.median(power[:, NOISY], axis=1) / np.log(2)
    total = _flatten_power(power) @ COUNTED + EMPTY
    power = np.maximum(power - 2 * noise[:, None, None], 0) * BAND
    above, steep, *turns = (_flatten_power(power) @ MOMENTS).T
    first, around = _strongest_peaks(power)
    held = _flatten_power(power * around) @ COUNTED
    power *= ~around & _crossing_mask(first)
    held += _flatten_power(power * _strongest_peaks(power)[1]) @ COUNTED
    return WindowSpectra(
        contrast=np.sqrt(above),
        periodic=np.minimum(held, above) / total,
        straight=np.maximum(np.hypot(*turns[:2]), np.hypot(*turns[2:])) / (steep + EMPTY),
    )


def _strongest_peaks(power: FloatMap) -> tuple[FloatMap, NDArray[np.bool_]]:
    """The (W, 2) frequency (x, y) of the highest peaks, and which frequencies belong to them."""
    places = power.reshape(len(power), -1).argmax(axis=1)
    peaks = np.stack([FREQUENCY_X.ravel()[places], FREQUENCY_Y.ravel()[places]], axis=-1)
    x, y = peaks[:, 0, None, None], peaks[:, 1, None, None]
    near = (FREQUENCY_X - x) ** 2 + (FREQUENCY_Y - y) ** 2 < PEAK_RADIUS**2
    mirrored = (FREQUENCY_X + x) ** 2 + (FREQUENCY_Y + y) ** 2 < PEAK_RADIUS**2
    return peaks, near | mirrored


def _crossing_mask(peaks: FloatMap) -> NDArray[np.bool_]:
    """Which frequencies stand at 30 degrees or more to the (W, 2) peaks."""
    x, y = peaks[:, 0, None, None], peaks[:, 1, None, None]
    length = np.maximum(np.hypot(x, y), EMPTY)
    return np.abs(x * FREQUENCY_Y - y * FREQUENCY_X) > CROSSING * length * FREQUENCY


def _flatten_power(power: FloatMap) -> FloatMap:
    return power.reshape(len(power), -1)


def _window_starts(side: int) -> NDArray[np.int64]:
    """Where the windows along one axis begin: about 48 px apart, the last one at the end."""
    last = max(side - WINDOW_PX, 0)
    return np.linspace(0, last, 1 + -(-last // STEP_PX)).astype(np.int64)


def _interpolate_windows(
    values: FloatMap, starts: list[NDArray[np.int64]], shape: tuple[int, ...]
) -> FloatMap:
    """(H, W) of one value a window, linear between the windows' middles."""
    steps = [at[1] - at[0] if len(at) > 1 else 1 for at in starts]
    y, x = (
        np.clip((np.arange(n) - WINDOW_PX / 2) / step, 0, len(at) - 1).astype(np.float32)
        for n, step, at in zip(shape, steps, starts, strict=True)
    )
    grid_x, grid_y = np.meshgrid(x, y)
    return np.asarray(cv2.remap(values.astype(np.float32), grid_x, grid_y, cv2.INTER_LINEAR))
