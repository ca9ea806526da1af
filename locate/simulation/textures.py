"""Pictures to cover surfaces with: periodic tiles, band-limited by mip levels."""

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from geometry.arrays import FloatMap

TEXTURE_PX = 1024
TEXEL_M = 0.005
MIP_LEVELS = 6
PAD_PX = 2
GRAIN, STONES, CLOUDS = range(3)


def _make_noise_texture(rng: np.random.Generator, slope: float) -> FloatMap:
    """Periodic noise whose amplitude falls with frequency to the power `slope`, std 1."""
    spectrum = np.fft.rfft2(rng.standard_normal((TEXTURE_PX, TEXTURE_PX)))
    frequency = np.hypot(np.fft.fftfreq(TEXTURE_PX)[:, None], np.fft.rfftfreq(TEXTURE_PX))
    frequency[0, 0] = np.inf
    tile = np.fft.irfft2(spectrum / frequency**slope, s=(TEXTURE_PX, TEXTURE_PX))
    return np.asarray(tile / tile.std(), dtype=np.float32)


def _make_stone_texture(rng: np.random.Generator) -> FloatMap:
    """Periodic gravel: each stone has a tone and darkens towards its edge, std 1."""
    centres = rng.uniform(0, TEXTURE_PX, (7000, 2))
    y, x = np.mgrid[0:TEXTURE_PX, 0:TEXTURE_PX]
    tree = KDTree(centres, boxsize=np.full(2, float(TEXTURE_PX)))
    found = tree.query(np.stack([y.ravel(), x.ravel()], axis=1), k=2)
    distance, nearest = np.asarray(found[0]), np.asarray(found[1])
    tone = rng.normal(0, 1, len(centres))[nearest[:, 0]]
    gap = np.clip((distance[:, 1] - distance[:, 0]) / 5, 0, 1)
    tile = tone * gap - 1.6 * (1 - gap)
    tile = (tile - tile.mean()) / tile.std()
    return np.asarray(tile.reshape(TEXTURE_PX, TEXTURE_PX), dtype=np.float32)


def make_noise_textures(rng: np.random.Generator) -> list[FloatMap]:
    """The tiles GRAIN, STONES and CLOUDS."""
    return [_make_noise_texture(rng, 1.0), _make_stone_texture(rng), _make_noise_texture(rng, 1.6)]


class TextureAtlas:
    """Periodic tiles of TILE_PX x TILE_PX with their mip levels, in one image."""

    def __init__(self, tiles: Sequence[FloatMap]) -> None:
        columns = []
        for tile in tiles:
            level, blocks = tile, []
            for _ in range(MIP_LEVELS):
                block = np.pad(level, PAD_PX, mode="wrap")
                blocks.append(
                    np.pad(block, ((0, 0), (0, TEXTURE_PX + 2 * PAD_PX - block.shape[1])))
                )
                level = cv2.resize(level, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA)
            columns.append(np.concatenate(blocks))
        self._image = np.concatenate(columns, axis=1)
        self._sizes = (TEXTURE_PX / 2.0 ** np.arange(MIP_LEVELS)).astype(np.float32)
        below = np.cumsum(self._sizes + 2 * PAD_PX) - self._sizes - 2 * PAD_PX
        self._tops = (below + PAD_PX - 0.5).astype(np.float32)

    def sample_texture(
        self, u_m: FloatMap, v_m: FloatMap, tile: int, footprint_m: FloatMap
    ) -> FloatMap:
        """The tile at (u, v), averaged over about `footprint_m`; any one shape."""
        lod = np.log2(np.clip(footprint_m, TEXEL_M, TEXEL_M * 2 ** (MIP_LEVELS - 1.01)) / TEXEL_M)
        low = lod.astype(np.intp)
        weight = (lod - low).astype(np.float32)
        u, v = (a * np.float32(1 / (TEXTURE_PX * TEXEL_M)) for a in (u_m, v_m))
        u -= np.floor(u)
        v -= np.floor(v)
        below = self._sample_level(u, v, tile, low)
        above = self._sample_level(u, v, tile, low + 1)
        return np.asarray(below + weight * (above - below), dtype=np.float32)

    def _sample_level(
        self, u: FloatMap, v: FloatMap, tile: int, level: NDArray[np.intp]
    ) -> FloatMap:
        """The tile at (u, v) in tile widths, from one mip level each."""
        size = self._sizes.take(level)
        x = u * size + np.float32(PAD_PX - 0.5 + tile * (TEXTURE_PX + 2 * PAD_PX))
        y = v * size + self._tops.take(level)
        rows = -(-len(x) // TEXTURE_PX)
        spare = rows * TEXTURE_PX - len(x)
        grid = [np.pad(a, (0, spare)).reshape(rows, TEXTURE_PX) for a in (x, y)]
        values = cv2.remap(self._image, grid[0], grid[1], cv2.INTER_LINEAR)
        return np.asarray(values.ravel()[: len(x)], dtype=np.float32)
