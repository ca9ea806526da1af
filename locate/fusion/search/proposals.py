"""Where a plume may be: sums of the evidence grid along sheared columns of voxels."""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import product

import cv2
import numpy as np

from geometry.arrays import FloatArray, FloatMap
from geometry.grid import EvidenceGrid, VoxelBox, sum_evidence
from locate.fusion.search.columns import Columns, PlumeColumn
from locate.fusion.views import Views

SLOPES = (-0.35, 0.0, 0.35)
"""Of the columns that are tried along X and Y, horizontal per vertical; chosen by hand."""
RADII_UNITS = (0.15, 0.3)
"""Of the discs that the grid is averaged over, units of fusion; chosen by hand."""
SEPARATION_UNITS = 0.5
"""Axes nearer than this are one column's, units of fusion; chosen by hand."""
OPENING_START = 0.1
"""Growth of the radius per unit of height that the search begins with; chosen by hand."""
MOST_PROPOSALS = 16
"""Columns that the search begins from; chosen by hand."""
FEWEST_VIEWS = 2.0
"""Voxels that fewer views see count as empty; chosen by hand."""


@dataclass(frozen=True, kw_only=True)
class ColumnProposals:
    """Columns found in a grid, best first.

    Attributes:
        columns: N columns.
        strength: (N,) summed evidence, in the grid's own unit: comparable between grids of the
            same box only.
    """

    columns: Columns
    strength: FloatArray


def best_interval(evidence: FloatMap) -> tuple[FloatMap, FloatMap, FloatMap]:
    """For each (y, x) of a (Z, Y, X) array the run of slices with the largest sum.

    Kadane's algorithm. Returns the sum, the first and the last slice of the run, each (Y, X).
    """
    running, start, best, first, last = np.zeros((5, *evidence.shape[1:]), np.float32)
    for k, layer in enumerate(evidence):
        np.copyto(start, k, where=running <= 0)
        running = np.maximum(running, 0) + layer
        better = running > best
        np.copyto(best, running, where=better)
        np.copyto(first, start, where=better)
        np.copyto(last, k, where=better)
    return best, first, last


def propose_columns(
    views: Views, box: VoxelBox, *, most: int
) -> tuple[ColumnProposals, EvidenceGrid]:
    """The `most` strongest, well separated columns of the summed evidence."""
    unit = views.unit
    grid = sum_evidence(box, views.trajectory, views.llr, views.inverse_depth)
    found = [
        candidate
        for sheared in _shear_grid(grid, unit)
        for candidate in _find_peaks(*sheared, box=box, unit=unit, most=most)
    ]
    found.sort(key=lambda pair: -pair[1])
    columns: list[PlumeColumn] = []
    strength: list[float] = []
    for column, value in found:
        apart = (np.hypot(*(column.middle_xy - other.middle_xy)) for other in columns)
        if all(gap > SEPARATION_UNITS * unit for gap in apart):
            columns.append(column)
            strength.append(value)
        if len(columns) == most:
            break
    return ColumnProposals(columns=Columns.of(columns), strength=np.array(strength)), grid


def _shear_grid(
    grid: EvidenceGrid, unit: float
) -> Iterator[tuple[FloatMap, tuple[float, float], float]]:
    """The grid averaged over discs and sheared, so that slanted columns stand upright."""
    evidence = np.where(grid.weight >= FEWEST_VIEWS, grid.llr, 0).astype(np.float32)
    for radius in RADII_UNITS:
        cells = max(1, round(radius * unit / grid.box.voxel))
        disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * cells + 1, 2 * cells + 1))
        disc = disc.astype(np.float32) / disc.sum()
        blurred = np.stack([cv2.filter2D(layer, -1, disc) for layer in evidence])
        for slope in product(SLOPES, SLOPES):
            sheared = np.empty_like(blurred)
            for k, layer in enumerate(blurred):
                shift = [-round(s * k) for s in slope]
                sheared[k] = np.roll(layer, shift, axis=(1, 0))
            yield sheared * np.float32(2 * radius), slope, radius


def _find_peaks(
    sheared: FloatMap,
    slope: tuple[float, float],
    radius: float,
    *,
    box: VoxelBox,
    unit: float,
    most: int,
) -> list[tuple[PlumeColumn, float]]:
    """The local maxima of the best run of slices: (column, strength)."""
    total, first, last = best_interval(sheared)
    size = 2 * max(1, round(SEPARATION_UNITS * unit / box.voxel)) + 1
    peak = (total == cv2.dilate(total, np.ones((size, size), np.uint8))) & (total > 0)
    rows, cols = np.nonzero(peak)
    strongest = np.argsort(-total[rows, cols])[:most]
    candidates = []
    for y, x in zip(rows[strongest], cols[strongest], strict=True):
        k = float(first[y, x])
        base = np.array([[k, y + round(slope[1] * k), x + round(slope[0] * k)]])
        height = (last[y, x] - k + 1) * box.voxel
        low = box.centers_in_world(base)[0] - [0, 0, box.voxel / 2]
        column = PlumeColumn(np.array([*low, *slope, height, radius * unit, OPENING_START]))
        candidates.append((column, float(total[y, x] * box.voxel / unit)))
    return candidates
