"""Backgrounds that are formulas: a warp of them is exact."""

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import gaussian_filter1d

from detect.synthesis.camera import Background
from geometry.arrays import FloatArray, FloatMap

EDGE_PX = 0.3
"""Width over which a printed edge changes from one tone to the other."""
TABLE_STEP_PX = 1 / 16


@dataclass(frozen=True, kw_only=True)
class PatternRanges:
    """How regular patterns may look.

    Attributes:
        period_px: Least and most.
        angle_deg: Least and most, of the direction across the lines.
        carriers: The most directions a sinusoid may have, 1 or 2.
    """

    period_px: tuple[float, float] = (4.0, 24.0)
    angle_deg: tuple[float, float] = (0.0, 180.0)
    carriers: int = 2

    def random_period(self, rng: np.random.Generator) -> float:
        """Short and long periods alike (log-uniform)."""
        return float(np.exp(rng.uniform(*np.log(self.period_px))))

    def random_angle(self, rng: np.random.Generator) -> float:
        """Uniform, rad."""
        return float(np.radians(rng.uniform(*self.angle_deg)))


def draw_sinusoid(rng: np.random.Generator, lattice: PatternRanges) -> Background:
    """One wave, or two that cross at 60 to 120 degrees."""
    count = int(rng.integers(1, lattice.carriers + 1))
    first = lattice.random_angle(rng)
    angles = [first, first + np.radians(rng.uniform(60, 120))][:count]
    waves = [
        2 * np.pi / lattice.random_period(rng) * np.array([np.cos(a), np.sin(a)]) for a in angles
    ]
    phases = rng.uniform(0, 2 * np.pi, count)
    tone = _draw_tones(rng)

    def radiance(x: FloatMap, y: FloatMap) -> FloatMap:
        total = sum(
            np.sin(np.float32(k[0]) * x + np.float32(k[1]) * y + np.float32(phase))
            for k, phase in zip(waves, phases, strict=True)
        )
        return tone(np.asarray(total, dtype=np.float32) / np.float32(count))

    return radiance


def draw_checkerboard(rng: np.random.Generator, lattice: PatternRanges) -> Background:
    """Squares in two tones; `period_px` spans two of them."""
    period, angle = lattice.random_period(rng), lattice.random_angle(rng)
    phases = rng.uniform(0, 2 * np.pi, 2).astype(np.float32)
    k = np.float32(2 * np.pi / period)
    c, s = np.float32(np.cos(angle)), np.float32(np.sin(angle))
    steep = np.float32(period / (np.pi * EDGE_PX))
    tone = _draw_tones(rng)

    def radiance(x: FloatMap, y: FloatMap) -> FloatMap:
        across = np.clip(steep * np.sin(k * (c * x + s * y) + phases[0]), -1, 1)
        along = np.clip(steep * np.sin(k * (c * y - s * x) + phases[1]), -1, 1)
        return tone(across * along)

    return radiance


def draw_parallel_lines(
    rng: np.random.Generator, lattice: PatternRanges, size_px: int
) -> Background:
    """Stripes of irregular width and tone, as in blinds, cladding, gratings and planks."""
    angle = lattice.random_angle(rng)
    reach_px = 1.5 * size_px
    mean_px = lattice.random_period(rng) / 2
    widths = mean_px * rng.gamma(2.5, 1 / 2.5, int(4 * reach_px / mean_px) + 8) + 1.0
    edges = np.cumsum(widths) - reach_px
    levels = rng.uniform(-1, 1, len(edges) + 1)
    if rng.random() < 0.5:
        levels[::2] = rng.uniform(-1, 1)
    places = np.arange(-reach_px, reach_px, TABLE_STEP_PX)
    table = levels[np.searchsorted(edges, places)]
    softness = rng.uniform(EDGE_PX, 2 * EDGE_PX) / TABLE_STEP_PX
    table = gaussian_filter1d(table, softness).astype(np.float32)
    c, s = np.float32(np.cos(angle)), np.float32(np.sin(angle))
    middle = np.float32(size_px / 2)
    tone = _draw_tones(rng)

    def radiance(x: FloatMap, y: FloatMap) -> FloatMap:
        across = c * (x - middle) + s * (y - middle)
        values = np.interp(across.ravel(), places, table).astype(np.float32)
        return tone(values.reshape(across.shape))

    return radiance


class _ToneCurve:
    """Turns -1 to 1 into radiance."""

    def __init__(self, middle: float, amplitude: float) -> None:
        self._middle, self._amplitude = np.float32(middle), np.float32(amplitude)

    def __call__(self, pattern: FloatMap) -> FloatMap:
        return np.asarray(self._middle + self._amplitude * pattern, dtype=np.float32)


def _draw_tones(rng: np.random.Generator) -> _ToneCurve:
    middle = rng.uniform(0.35, 0.6)
    return _ToneCurve(middle, rng.uniform(0.12, 0.95) * (middle - 0.03))


def view_obliquely(pattern: Background, tilt: FloatArray, size_px: int) -> Background:
    """The pattern on a wall that recedes by `tilt` (2,) from one side of the frame to the other."""
    a, b = (tilt / size_px).astype(np.float32)
    middle = np.float32(size_px / 2)

    def radiance(x: FloatMap, y: FloatMap) -> FloatMap:
        across, down = x - middle, y - middle
        near = 1 / (1 + a * across + b * down)
        return pattern(middle + across * near, middle + down * near)

    return radiance


def light_unevenly(background: Background, fall: FloatArray, size_px: int) -> Background:
    """The background under light that falls off linearly, by `fall` (2,) over the frame."""
    a, b = (fall / size_px).astype(np.float32)
    brightest = np.float32(1 / (1 + np.abs(fall).sum() / 2))

    def radiance(x: FloatMap, y: FloatMap) -> FloatMap:
        light = 1 + a * (x - size_px / 2) + b * (y - size_px / 2)
        return np.asarray(background(x, y) * (brightest * light), dtype=np.float32)

    return radiance
