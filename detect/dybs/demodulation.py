"""The displacement of a lattice, by the phase of its waves: nothing is learned.

Source: Takeda, Ina, Kobayashi, JOSA 72 (1982) 156 (fringe analysis by the Fourier transform);
Wildeman, Experiments in Fluids 59 (2018) 97 (checkerboards, two waves). Theirs compare with an
image without the plume. Here a plane lattice seen in perspective stands in for it, robustly fitted
to most of a tile, and what is left is taken for the plume. No phase is ever unwrapped: each is
measured against one that already follows it. A plume that fills a tile is partly lost.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import product

import cv2
import numpy as np

from detect.dybs.lattice_tile import LatticeTile
from geometry.arrays import BoolArray, FloatMap, GreyImage

TILE_PX, OVERLAP_PX, SMALLEST_PX = 192, 32, 48
LEAST_SHARE = 0.5

Part = tuple[slice, slice]


@dataclass(frozen=True, kw_only=True)
class LatticeDisplacement:
    """What the waves of an image measure.

    Attributes:
        displacement: (H, W, 2) px, x right, y down; across the lines alone where there is one wave.
        information: (H, W, 3) xx, xy and yy of the inverse covariance, 1 / px^2; 0 where nothing
            is known. Of one wave it is singular.
    """

    displacement: FloatMap
    information: FloatMap


def demodulate_lattice(image: GreyImage, lattice: BoolArray) -> LatticeDisplacement:
    """Measures what a lattice shows, tile by tile.

    Args:
        image: (H, W) grey values.
        lattice: (H, W) where there is one; elsewhere nothing is measured.
    """
    height, width = image.shape
    maps = demodulate_halved(image, lattice)
    if maps.any():
        even = (2 * maps.shape[1], 2 * maps.shape[0])
        maps = np.asarray(cv2.resize(maps, even))[:height, :width]
        maps[~lattice] = 0
    else:
        maps = np.zeros((height, width, 5), np.float32)
    return LatticeDisplacement(displacement=maps[..., :2], information=maps[..., 2:])


def demodulate_halved(image: GreyImage, lattice: BoolArray) -> FloatMap:
    """(H/2, W/2, 5), rounded up: displacement x, y; information xx, xy, yy."""
    maps = np.zeros((*[(side + 1) // 2 for side in image.shape], 5), np.float32)
    if not lattice.any():
        return maps
    even = [(0, side % 2) for side in image.shape]
    grey = np.pad(image, even, mode="edge").astype(np.float32)
    inside = np.pad(lattice, even, mode="edge").astype(np.float32)
    total = np.full(maps.shape[:2], 1e-6, np.float32)
    for part, half, window in _cut_tiles(grey.shape):
        if inside[part].mean() >= LEAST_SHARE:
            maps[half] += window[..., None] * LatticeTile(grey[part], inside[part]).measure()
            total[half] += window
    maps /= total[..., None]
    maps[~lattice[::2, ::2]] = 0
    return maps


def _cut_tiles(shape: tuple[int, ...]) -> Iterator[tuple[Part, Part, FloatMap]]:
    """Where the tiles lie, in the image and at half its resolution, and their weights there.

    Weights fall towards a tile's edge.
    """
    if min(shape) < SMALLEST_PX:
        return
    spans, ramps = [], []
    for side in shape:
        size = min(side, TILE_PX)
        count = 1 + -(-(side - size) // (TILE_PX - OVERLAP_PX))
        starts = np.linspace(0, side - size, count).astype(int) // 2 * 2
        spans.append([slice(start, start + size) for start in starts])
        inside = np.minimum(np.arange(size // 2) + 1, size // 2 - np.arange(size // 2))
        ramps.append(np.minimum(2 * inside / OVERLAP_PX, 1).astype(np.float32))
    for part in product(*spans):
        rows, columns = (slice(span.start // 2, span.stop // 2) for span in part)
        yield (part[0], part[1]), (rows, columns), ramps[0][:, None] * ramps[1]
