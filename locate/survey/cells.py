"""The ground in cells: how often each was covered, and how often something rose there."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.stats import norm

from geometry.arrays import FloatArray, FloatMap, IntArray
from locate.survey.coverage import FlightCoverage
from locate.survey.occurrence import beta_posterior, pooled_prior, posterior_mean

LATTICE = 15
"""Points each way that stand for a normal density; chosen."""
LATTICE_SIGMAS = 3.0
"""How far they reach."""


@dataclass(frozen=True, kw_only=True)
class CellGrid:
    """A window of cells with the counts of all flights.

    Attributes:
        low: (2,) number of the first cell, east and north.
        cell_m: Edge of a cell.
        bins: Labels of season and hours.
        covered: (B, H, W) flights of each bin that covered the cell, row 0 in the south.
        seen: (B, H, W) flights that detected something, shared between cells where the place is
            uncertain.
        limit_px: (H, W) of the weakest column that any flight would have detected.
    """

    low: IntArray
    cell_m: float
    bins: tuple[str, ...]
    covered: FloatArray
    seen: FloatArray
    limit_px: FloatMap

    @property
    def shape(self) -> tuple[int, int]:
        """Rows (north) and columns (east)."""
        rows, columns = self.limit_px.shape
        return rows, columns

    @cached_property
    def prior(self) -> tuple[float, float]:
        """Mean and weight of the prior of a cell."""
        return pooled_prior(self.covered, self.seen)

    @cached_property
    def overall_probability(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """(H, W) each: probability over all flights, its 5 % and its 95 % quantile."""
        return beta_posterior(self.covered.sum(axis=0), self.seen.sum(axis=0), self.prior)

    def in_bin(self, index: int) -> FloatArray:
        """(H, W) probability in one bin; its prior is the mean of the cell over all flights."""
        mean = np.nan_to_num(self.overall_probability[0], nan=self.prior[0])
        return posterior_mean(self.covered[index], self.seen[index], (mean, self.prior[1]))


@dataclass(frozen=True, kw_only=True)
class SightingPlace:
    """Where something was detected: the flight's index, the place (m) and its (2, 2) covariance."""

    flight: int
    position: FloatArray
    covariance: FloatArray


def count_cells(
    coverages: Sequence[FlightCoverage | None],
    bin_of: Sequence[str],
    places: Sequence[SightingPlace],
    *,
    bins: tuple[str, ...],
    cell_m: float,
    weakest_px: float,
) -> CellGrid | None:
    """Adds up what F flights covered and detected; None where no coverage is known.

    Args:
        coverages: Of each flight; None where it is not known.
        bin_of: The bin of each flight.
        places: Of the sightings.
        bins: All bins, in order.
        cell_m: Edge of a cell.
        weakest_px: A flight covered a cell where it would have detected a column of this.
    """
    known = [one for one in coverages if one is not None and one.limit_px.size]
    if not known:
        return None
    low = np.min([one.low for one in known], axis=0)
    high = np.max([one.low + one.limit_px.shape[::-1] for one in known], axis=0)
    columns, rows = (high - low).tolist()
    covered = np.zeros((len(bins), rows, columns))
    seen, limit_px = np.zeros_like(covered), np.full((rows, columns), np.inf, np.float32)
    for index, (one, name) in enumerate(zip(coverages, bin_of, strict=True)):
        detected = np.zeros((rows, columns))
        for place in (place for place in places if place.flight == index):
            detected = np.maximum(detected, spread_over_cells(place, low, (rows, columns), cell_m))
        detectable = np.zeros_like(detected)
        if one is not None and one.limit_px.size:
            window = _grid_window(one, low)
            detectable[window] = one.limit_px <= weakest_px
            limit_px[window] = np.minimum(limit_px[window], one.limit_px)
        covered[bins.index(name)] += np.maximum(detectable, detected)
        seen[bins.index(name)] += detected
    return CellGrid(
        low=low, cell_m=cell_m, bins=bins, covered=covered, seen=seen, limit_px=limit_px
    )


def _grid_window(one: FlightCoverage, low: IntArray) -> tuple[slice, slice]:
    column, row = (one.low - low).tolist()
    height, width = one.limit_px.shape
    return slice(row, row + height), slice(column, column + width)


def spread_over_cells(
    place: SightingPlace, low: IntArray, shape: tuple[int, int], cell_m: float
) -> FloatArray:
    """(H, W) share of a place that lies in each cell; what lies outside of the window is lost."""
    steps = np.linspace(-LATTICE_SIGMAS, LATTICE_SIGMAS, LATTICE)
    weight = np.outer(norm.pdf(steps), norm.pdf(steps)).ravel()
    grid = np.stack(np.meshgrid(steps, steps), axis=-1).reshape(-1, 2)
    places = place.position[:2] + grid @ np.linalg.cholesky(place.covariance).T
    columns, rows = (np.floor(places / cell_m).astype(int) - low).T
    inside = (columns >= 0) & (columns < shape[1]) & (rows >= 0) & (rows < shape[0])
    flat = rows[inside] * shape[1] + columns[inside]
    shares = np.bincount(flat, weight[inside] / weight.sum(), minlength=shape[0] * shape[1])
    return np.asarray(shares.reshape(shape), dtype=float)
