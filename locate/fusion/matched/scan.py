"""The whole volume scanned for axes about which the displacement turns."""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import product
from typing import Self

import cv2
import numpy as np

from geometry.arrays import FloatArray, FloatMap, IntArray
from geometry.grid import EvidenceGrid
from locate.fusion.matched.filters import SIDES, TurnFilters
from locate.fusion.matched.score import FEWEST_VIEWS, LENGTHS_UNITS, WIDTHS_UNITS, join_sides
from locate.fusion.search.columns import Columns

SIDE_SHARE, HEIGHT_SHARE = 0.8, 4.0
"""Spacing of the places and of the heights that are tried, in widths; chosen by hand."""
SLOPES = (-0.3, -0.15, 0.0, 0.15, 0.3)
"""Of the axes that are tried along X and Y, horizontal per vertical; chosen by hand."""
PEAKS_OF_WIDTH = 40
"""Places that are kept of every width; chosen by hand."""
APART_UNITS = 0.25
"""Distance of two places of one width, units of fusion; chosen by hand."""
MOST_PLACES = 4e6
"""Of one width in a volume; where it would take more they are spaced more widely."""
SHOWN_PLACE = 3.0
"""Views that must show a voxel for a place in it to be tried."""


@dataclass(frozen=True, kw_only=True)
class TurnVolume:
    """What all views show of upright axes of one width, on a grid of places and heights.

    Attributes:
        low: (3,) world position of the first place at the first height.
        spacing: (3,) of the places along X and Y and of the heights, world units.
        width: From the axis to the largest displacement, world units.
        sides: (2, Z, Y, X) weighted sigmas of either side, summed over the views.
        weight: (Z, Y, X) squared weights, summed over the views.
    """

    low: FloatArray
    spacing: FloatArray
    width: float
    sides: FloatMap
    weight: FloatMap

    @classmethod
    def measure(cls, filters: TurnFilters, grid: EvidenceGrid, width: float) -> Self:
        """Samples the places that enough views show.

        Args:
            filters: Of the views.
            grid: Says how many views show each voxel.
            width: World units.
        """
        box = grid.box
        spacing = width * np.array([SIDE_SHARE, SIDE_SHARE, HEIGHT_SHARE])
        size = np.array(box.shape[::-1]) * box.voxel
        places = float(np.prod(size / spacing))
        spacing = spacing * max(1.0, (places / MOST_PLACES) ** (1 / 3))
        counts = np.maximum(size / spacing, 1).astype(int)
        x, y, z = (np.arange(count) * step for count, step in zip(counts, spacing, strict=True))
        column, row, layer = (
            np.minimum((offsets / box.voxel).astype(int), cells - 1)
            for offsets, cells in zip((x, y, z), box.shape[::-1], strict=True)
        )
        sides = np.zeros((SIDES, len(z), len(y), len(x)), np.float32)
        weight = np.zeros((len(z), len(y), len(x)), np.float32)
        for level, height in enumerate(z):
            seen = grid.weight[layer[level]][np.ix_(row, column)] >= SHOWN_PLACE
            at_y, at_x = np.nonzero(seen)
            offsets = np.column_stack([x[at_x], y[at_y], np.full(len(at_x), height)])
            upright = np.broadcast_to([0.0, 0.0, 1.0], offsets.shape)
            widths = np.full(len(offsets), width)
            samples = filters.sample(box.low_in_world + offsets, widths, upright)
            sides[:, level, at_y, at_x] = (samples.limited * samples.weight).sum(axis=1)
            weight[level, at_y, at_x] = (samples.weight**2).sum(axis=0)
        return cls(low=box.low_in_world, spacing=spacing, width=width, sides=sides, weight=weight)

    def sheared_sigmas(self, unit: float) -> Iterator[tuple[FloatMap, tuple[float, float], int]]:
        """Sigmas of all columns of one slope and length, by their lowest height and place.

        Yields (Z', Y, X) sigmas without their sign, the slopes along X and Y, and the length in
        heights; Y and X are those of the axis at the first height of the grid.
        """
        levels = np.arange(len(self.weight))
        for slopes in product(SLOPES, SLOPES):
            moves = np.rint(np.outer(levels * self.spacing[2], slopes) / self.spacing[:2])
            first, second, weight = (
                _cumulate_sheared(each, moves.astype(np.int64))
                for each in (*self.sides, self.weight)
            )
            for length in LENGTHS_UNITS:
                count = max(1, round(length * unit / self.spacing[2]))
                if count > len(self.weight):
                    continue
                sides = (each[count:] - each[:-count] for each in (first, second))
                seen = weight[count:] - weight[:-count]
                np.maximum(seen, np.float32(FEWEST_VIEWS * count / 2), out=seen)
                sigmas = np.abs(join_sides(*sides))
                sigmas /= np.sqrt(seen, out=seen)
                yield sigmas, slopes, count


def _cumulate_sheared(maps: FloatMap, moves: IntArray) -> FloatMap:
    """Sums over the first k layers, for k from 0, each moved back by its (x, y) move.

    What comes in from outside is 0.
    """
    layers, height, width = maps.shape
    sums = np.empty((layers + 1, height, width), maps.dtype)
    sums[0] = 0
    for k, (right, down) in enumerate(moves.tolist()):
        sums[k + 1] = sums[k]
        if abs(right) < width and abs(down) < height:
            to = sums[k + 1, max(-down, 0) : height - max(down, 0)]
            part = maps[k, max(down, 0) : height + min(down, 0)]
            to[:, max(-right, 0) : width - max(right, 0)] += part[
                :, max(right, 0) : width + min(right, 0)
            ]
    return sums


@dataclass(frozen=True, kw_only=True)
class StrongestByPlace:
    """The column of one width that turns most at each place of a grid, seen from above.

    Attributes:
        sigmas: (Y, X) of it, without sign; 0 where no column is shown.
        columns: (Y, X, 8) the column, its radius the width.
    """

    sigmas: FloatMap
    columns: FloatArray

    @classmethod
    def of(cls, volume: TurnVolume, unit: float) -> Self:
        """Compares all slopes, lengths and heights at each place."""
        shape = volume.weight.shape[1:]
        best = np.zeros(shape, np.float32)
        rows = np.zeros((*shape, 4))
        for sigmas, slopes, count in volume.sheared_sigmas(unit):
            top = sigmas.max(axis=0)
            better = top > best
            best[better] = top[better]
            lowest = sigmas[:, better].argmax(axis=0)
            rows[better] = np.column_stack(
                [lowest, np.broadcast_to([*slopes, count], (len(lowest), 3))]
            )
        lowest, slope_x, slope_y, count = np.moveaxis(rows, -1, 0)
        step_x, step_y, step_z = volume.spacing
        rise = lowest * step_z
        columns = np.zeros((*shape, 8))
        columns[..., 0] = volume.low[0] + np.arange(shape[1]) * step_x + slope_x * rise
        columns[..., 1] = volume.low[1] + np.arange(shape[0])[:, None] * step_y + slope_y * rise
        columns[..., 2] = volume.low[2] + rise
        columns[..., 3:6] = np.stack([slope_x, slope_y, count * step_z], axis=-1)
        columns[..., 6] = volume.width
        return cls(sigmas=best, columns=columns)


def find_peaks(volume: TurnVolume, unit: float) -> Columns:
    """The columns of one width that turn most, of those near each other the best alone."""
    strongest = StrongestByPlace.of(volume, unit)
    best = strongest.sigmas
    side = 2 * max(1, round(APART_UNITS * unit / volume.spacing[0])) + 1
    peak = (best == cv2.dilate(best, np.ones((side, side), np.uint8))) & (best > 0)
    y, x = np.nonzero(peak)
    kept = np.argsort(-best[y, x], kind="stable")[:PEAKS_OF_WIDTH]
    return Columns(strongest.columns[y[kept], x[kept]])


def propose_turns(filters: TurnFilters, grid: EvidenceGrid) -> Columns:
    """The columns of all widths that the refinement begins from."""
    unit = filters.views.unit
    columns = Columns(np.empty((0, 8)))
    for width in WIDTHS_UNITS:
        volume = TurnVolume.measure(filters, grid, width * unit)
        columns = columns.followed_by(find_peaks(volume, unit))
    return columns
