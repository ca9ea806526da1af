"""Backgrounds to print: a page of ink as a formula of the position on paper."""

from collections.abc import Callable
from itertools import product
from typing import Literal, TypeAlias, get_args

import numpy as np
from numpy.typing import NDArray

from geometry.arrays import FloatArray, FloatMap, GreyImage

PrintKind = Literal["checkerboard", "sinusoid", "perlin", "squares"]
PRINT_KINDS: tuple[PrintKind, ...] = get_args(PrintKind)
Pattern: TypeAlias = Callable[[FloatArray, FloatArray], FloatMap]
"""Reflectance, 0 black to 1 white, at (W,) places x and (H,) places y on the page, mm."""

MM_PER_INCH = 25.4
OCTAVES = 5
CONTRAST = 0.2
PROBES = 256
SQUARE_ODDS = (0.25, 0.25, 0.5)
"""Of black, white, and what lies below."""
BAND_ROWS = 256


def pattern(
    kind: PrintKind, period_mm: float, *, seed: int, page_mm: tuple[float, float]
) -> Pattern:
    """A pattern on a page of (width, height).

    Args:
        kind: `checkerboard`: squares of half a period. `sinusoid`: one wave across and one down
            (the paper's). `perlin`: gradient noise in five octaves, the finest cells half a
            period wide. `squares`: black and white squares in five sizes, the smallest half a
            period wide, the largest eight periods.
        period_mm: Of the finest detail.
        seed: Of what is random; checkerboard and sinusoid have no chance in them.
        page_mm: Width and height.
    """
    rng = np.random.default_rng(seed)
    match kind:
        case "checkerboard":
            return lambda x, y: _checkerboard_page(x, y, period_mm)
        case "sinusoid":
            return lambda x, y: _sinusoid_page(x, y, period_mm)
        case "perlin":
            return _perlin_noise(rng, period_mm / 2, page_mm)
        case "squares":
            return _random_squares(rng, period_mm / 2, page_mm)


def rasterise_page(pattern: Pattern, page_mm: tuple[float, float], dpi: float) -> GreyImage:
    """(H, W) the page in dots; the last column and row may reach over its edge by less than one."""
    width, height = (int(np.ceil(side / MM_PER_INCH * dpi - 1e-6)) for side in page_mm)
    x, y = ((np.arange(n, dtype=float) + 0.5) * MM_PER_INCH / dpi for n in (width, height))
    bands = [pattern(x, y[top : top + BAND_ROWS]) for top in range(0, height, BAND_ROWS)]
    return np.concatenate([np.rint(255 * band).astype(np.uint8) for band in bands])


def _sinusoid_page(x: FloatArray, y: FloatArray, period_mm: float) -> FloatMap:
    across, down = (0.25 * np.sin(2 * np.pi / period_mm * places) for places in (x, y))
    return np.asarray(0.5 + across + down[:, None], dtype=np.float32)


def _checkerboard_page(x: FloatArray, y: FloatArray, period_mm: float) -> FloatMap:
    column, row = (np.floor(2 * places / period_mm).astype(int) for places in (x, y))
    return np.asarray((column + row[:, None]) % 2, dtype=np.float32)


def _random_squares(
    rng: np.random.Generator, edge_mm: float, page_mm: tuple[float, float]
) -> Pattern:
    layers: list[tuple[float, FloatMap]] = []
    for edge in edge_mm * 2.0 ** np.arange(OCTAVES - 1, -1, -1):
        columns, rows = (int(side / edge) + 2 for side in page_mm)
        odds = SQUARE_ODDS if layers else (0.5, 0.5, 0)
        tones = rng.choice([0, 1, np.nan], (rows, columns), p=odds).astype(np.float32)
        layers.append((float(edge), tones))

    def reflectance(x: FloatArray, y: FloatArray) -> FloatMap:
        page = np.zeros((len(y), len(x)), np.float32)
        for edge, tones in layers:
            layer = tones[np.ix_((y / edge).astype(int), (x / edge).astype(int))]
            page = np.where(np.isnan(layer), page, layer)
        return page

    return reflectance


def _perlin_noise(
    rng: np.random.Generator, cell_mm: float, page_mm: tuple[float, float]
) -> Pattern:
    """Gradient noise (Perlin, SIGGRAPH 1985) in octaves of equal strength."""
    octaves = []
    for octave in range(OCTAVES):
        cell = cell_mm * 2**octave
        columns, rows = (int(side / cell) + 3 for side in page_mm)
        slopes = np.exp(1j * rng.uniform(0, 2 * np.pi, (rows, columns))).astype(np.complex64)
        octaves.append((cell, slopes))

    def noise(x: FloatArray, y: FloatArray) -> FloatMap:
        return np.asarray(sum(_gradient_noise(x / cell, y / cell, g) for cell, g in octaves))

    across, down = (np.linspace(0, side, PROBES) for side in page_mm)
    spread = noise(across, down).std()
    return lambda x, y: np.clip(0.5 + CONTRAST * noise(x, y) / spread, 0, 1)


def _gradient_noise(x: FloatArray, y: FloatArray, slopes: NDArray[np.complex64]) -> FloatMap:
    """One octave at places counted in cells; a slope is along x + 1j along y."""
    column, row = x.astype(int), y.astype(int)
    tx, ty = (x - column).astype(np.float32), (y - row).astype(np.float32)[:, None]
    total = np.zeros((len(y), len(x)), np.float32)
    for down, right in product((0, 1), repeat=2):
        corner = slopes[np.ix_(row + down, column + right)]
        weight = _smooth_step(np.abs(1 - down - ty)) * _smooth_step(np.abs(1 - right - tx))
        total += weight * (corner.real * (tx - right) + corner.imag * (ty - down))
    return total


def _smooth_step(t: FloatMap) -> FloatMap:
    return t**3 * (t * (6 * t - 15) + 10)
