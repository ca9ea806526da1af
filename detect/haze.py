"""Haze: air that moves all over the image, and not the noise that video codecs carry on.

Such noise lasts from frame to frame as moving air does, but it is not of the same displacement in
windows that lie side by side, where air is. What a codec leaves was measured on still pictures
coded at 0.06 to 0.2 bits a pixel: a correlation of at most 0.06 between windows `APART_PX` apart.
"""

from dataclasses import dataclass

import numpy as np

from detect.fluctuation import NOISE, WINDOW_PX, relative_tone, shifts_px
from detect.steady import SteadyImages, shrink
from detect.warp import blur, gradients, structure_tensor
from geometry.arrays import BoolArray, FloatMap

POOL_PX, APART_PX = 4.0, 16
"""Standard deviation of the blur of displacements, and distance of the windows compared, px."""
LEAST_CORRELATION = 0.075
"""Correlation at that distance from which the whole image moves as air does; chosen by hand,
between what codecs leave (.06) and haze (.09 to .58)."""
LEAST_PX, SHAKING_SHARE = 0.08, 0.14
"""Least displacement of haze, px of the shrunk frames, and as a share of the camera's own motion,
of which a coded recording keeps some (.11); by hand."""
INDEPENDENT_PX = 6
"""Distance of two pixels whose noise has little in common, px: three windows."""
KEPT = 0.5
"""Share of a displacement that the window must leave of it for a pixel to count; by hand."""
ROWS, COLUMNS, LEAST_SHARE = 5, 4, 0.03
"""Cells whose haze is stated, and the share of usable pixels that each needs, and the whole
image; chosen by hand."""
FEWEST_FRAMES = 8
"""Frames that are needed; chosen by hand."""


@dataclass(frozen=True, kw_only=True)
class Haze:
    """Moving air all over the image of a camera at rest.

    Attributes:
        rms_px: Root mean square of the displacement, both components, of the median pixel, px of
            the frames; structures finer than about 4 px of 320 are lessened.
        cells_px: The same by `ROWS` from the top and `COLUMNS` from the left; None where there is
            too little texture.
    """

    rms_px: float
    cells_px: tuple[tuple[float | None, ...], ...]

    @property
    def largest_px(self) -> float:
        """Of the cell where it is strongest."""
        return max((cell for row in self.cells_px for cell in row if cell), default=self.rms_px)

    def by_height(self) -> list[float | None]:
        """Median of the cells of each row, from the top."""
        known = [[cell for cell in row if cell is not None] for row in self.cells_px]
        return [float(np.median(row)) if row else None for row in known]


def measure_haze(images: SteadyImages) -> Haze | None:
    """The haze before a camera at rest; None where it is not all over the image.

    Args:
        images: T frames, not necessarily close in time.
    """
    if len(images) < FEWEST_FRAMES:
        return None
    small = [shrink(image) for image in images]
    shifts, picture = shifts_px(small), np.mean([relative_tone(image) for image in small], axis=0)
    usable = _textured(picture)
    if usable.mean() < LEAST_SHARE:
        return None
    pooled = np.stack([[blur(plane, POOL_PX) for plane in shift] for shift in shifts])
    variance = np.median(_side_by_side(pooled, 0)[usable])
    alike = np.median(_side_by_side(pooled, APART_PX)[usable])
    power = _side_by_side(shifts, INDEPENDENT_PX)
    least_px = max(LEAST_PX, SHAKING_SHARE * images.shaking.rms_px)
    if alike < LEAST_CORRELATION * variance or _root_of_median(power, usable) < least_px:
        return None
    power *= (images[0].shape[1] / small[0].shape[1]) ** 2
    return Haze(rms_px=_root_of_median(power, usable), cells_px=_cells(power, usable))


def _textured(picture: FloatMap) -> BoolArray:
    """(H, W) where the windows keep most of a displacement, whatever its direction."""
    xx, xy, yy = structure_tensor(*gradients(picture), WINDOW_PX)
    weakest = (xx + yy) / 2 - np.sqrt(((xx - yy) / 2) ** 2 + xy**2)
    return np.asarray(weakest > NOISE**2 * KEPT / (1 - KEPT))


def _side_by_side(shifts_px: FloatMap, apart: int) -> FloatMap:
    """(H, W) mean product of the displacements of windows that lie `apart` px from each other."""
    height, width = shifts_px.shape[2:]
    half, rest = apart // 2, apart - apart // 2
    total = np.zeros((height, width), np.float32)
    for first, second, pad in (
        (shifts_px[:, :, apart:], shifts_px[:, :, : height - apart], ((half, rest), (0, 0))),
        (shifts_px[..., apart:], shifts_px[..., : width - apart], ((0, 0), (half, rest))),
    ):
        products = np.einsum("tchw,tchw->hw", first, second) / len(shifts_px)
        total += np.pad(products, pad, mode="edge") / 2
    return total


def _root_of_median(power: FloatMap, usable: BoolArray) -> float:
    return float(np.sqrt(max(0.0, float(np.median(power[usable])))))


def _cells(power: FloatMap, usable: BoolArray) -> tuple[tuple[float | None, ...], ...]:
    def split(plane: np.ndarray) -> list[list[np.ndarray]]:
        rows = np.array_split(plane, ROWS, axis=0)
        return [np.array_split(row, COLUMNS, axis=1) for row in rows]

    return tuple(
        tuple(
            _root_of_median(cell, where) if where.mean() >= LEAST_SHARE else None
            for cell, where in zip(row, usable_row, strict=True)
        )
        for row, usable_row in zip(split(power), split(usable), strict=True)
    )
