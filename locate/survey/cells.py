"""The ground in cells: how often each was looked at, and how often something rose there."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.stats import norm

from geometry.arrays import FloatArray, FloatMap, IntArray
from locate.survey.coverage import Looks
from locate.survey.occurrence import pooled_prior, posterior, posterior_mean

LATTICE = 15
LATTICE_SIGMAS = 3.0


@dataclass(frozen=True, kw_only=True)
class Cells:
    """A window of cells with what all flights say of them.

    Attributes:
        low: (2,) number of the first cell, east and north.
        cell_m: Edge of a cell.
        bins: Labels of season and hours.
        looked: (B, H, W) flights of each bin that looked, row 0 in the south.
        seen: (B, H, W) flights that saw something, shared between cells where the place is unsure.
        limit_px: (H, W) of the weakest column that any flight would have found.
    """

    low: IntArray
    cell_m: float
    bins: tuple[str, ...]
    looked: FloatArray
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
        return pooled_prior(self.looked, self.seen)

    @cached_property
    def overall(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """(H, W) each: probability over all flights, its 5 % and its 95 % quantile."""
        return posterior(self.looked.sum(axis=0), self.seen.sum(axis=0), self.prior)

    def in_bin(self, index: int) -> FloatArray:
        """(H, W) probability in one bin; its prior is what the cell shows over all flights."""
        mean = np.nan_to_num(self.overall[0], nan=self.prior[0])
        return posterior_mean(self.looked[index], self.seen[index], (mean, self.prior[1]))


@dataclass(frozen=True, kw_only=True)
class Spot:
    """Where something was seen: the flight's index, the place (m) and its (2, 2) covariance."""

    flight: int
    position: FloatArray
    covariance: FloatArray


def count_cells(
    looks: Sequence[Looks | None],
    bin_of: Sequence[str],
    spots: Sequence[Spot],
    *,
    bins: tuple[str, ...],
    cell_m: float,
    weakest_px: float,
) -> Cells | None:
    """Adds up what F flights looked at and saw; None where no flight knows where it looked.

    Args:
        looks: Of each flight; None where they are not known.
        bin_of: The bin of each flight.
        spots: What was seen.
        bins: All bins, in order.
        cell_m: Edge of a cell.
        weakest_px: What a look must have been able to find.
    """
    known = [one for one in looks if one is not None and one.limit_px.size]
    if not known:
        return None
    low = np.min([one.low for one in known], axis=0)
    high = np.max([one.low + one.limit_px.shape[::-1] for one in known], axis=0)
    columns, rows = (high - low).tolist()
    looked = np.zeros((len(bins), rows, columns))
    seen, limit_px = np.zeros_like(looked), np.full((rows, columns), np.inf, np.float32)
    for index, (one, name) in enumerate(zip(looks, bin_of, strict=True)):
        saw = np.zeros((rows, columns))
        for spot in (spot for spot in spots if spot.flight == index):
            saw = np.maximum(saw, spread(spot, low, (rows, columns), cell_m))
        could = np.zeros_like(saw)
        if one is not None and one.limit_px.size:
            window = _window(one, low)
            could[window] = one.limit_px <= weakest_px
            limit_px[window] = np.minimum(limit_px[window], one.limit_px)
        looked[bins.index(name)] += np.maximum(could, saw)
        seen[bins.index(name)] += saw
    return Cells(low=low, cell_m=cell_m, bins=bins, looked=looked, seen=seen, limit_px=limit_px)


def _window(one: Looks, low: IntArray) -> tuple[slice, slice]:
    column, row = (one.low - low).tolist()
    height, width = one.limit_px.shape
    return slice(row, row + height), slice(column, column + width)


def spread(spot: Spot, low: IntArray, shape: tuple[int, int], cell_m: float) -> FloatArray:
    """(H, W) share of a place that lies in each cell; what lies outside of the window is lost."""
    steps = np.linspace(-LATTICE_SIGMAS, LATTICE_SIGMAS, LATTICE)
    weight = np.outer(norm.pdf(steps), norm.pdf(steps)).ravel()
    grid = np.stack(np.meshgrid(steps, steps), axis=-1).reshape(-1, 2)
    places = spot.position[:2] + grid @ np.linalg.cholesky(spot.covariance).T
    columns, rows = (np.floor(places / cell_m).astype(int) - low).T
    inside = (columns >= 0) & (columns < shape[1]) & (rows >= 0) & (rows < shape[0])
    flat = rows[inside] * shape[1] + columns[inside]
    shares = np.bincount(flat, weight[inside] / weight.sum(), minlength=shape[0] * shape[1])
    return np.asarray(shares.reshape(shape), dtype=float)
