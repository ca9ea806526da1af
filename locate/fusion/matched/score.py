"""How surely the displacement turns about the axes of columns, all views together."""

import math
from dataclasses import dataclass, replace
from functools import reduce
from itertools import product
from typing import Self, TypeVar

import numpy as np

from geometry.arrays import FloatArray, FloatMap, IntArray
from geometry.normal_errors import MEDIAN_SPREAD
from locate.fusion.matched.filters import (
    MOST_SIGMAS,
    SIDES,
    TurnFilters,
    TurnSamples,
    scatter_of,
)
from locate.fusion.search.columns import (
    HEIGHT,
    RADIUS,
    SLOPE_X,
    SLOPE_Y,
    Columns,
    PlumeColumn,
    X,
    Z,
)
from locate.fusion.search.score import mask_out

ALONG = 8
"""Points of an axis that are sampled; chosen by hand."""
WIDTHS_UNITS = (0.08, 0.125, 0.2, 0.32)
LENGTHS_UNITS = (0.6, 1.2, 2.4)
"""Widths and heights of the random columns that the noise is taken from, units of fusion."""
RANDOM_COLUMNS = 600
"""Of every width and height; chosen by hand."""
SLOPE_SIGMA = 0.15
"""Standard deviation of their slopes; chosen by hand."""
FEWEST_VIEWS = 4.0
"""Views that must show a column."""
SEEN = 0.1
"""Weight from which on a view shows a column."""
SHARED = 0.01
"""Share of the variance of a view that all views have in common where a search finds them to agree:
more than at random columns. Set on recordings without a plume and with weak ones
(docs/weak_plumes.md)."""
Sigmas = TypeVar("Sigmas", FloatArray, FloatMap)


@dataclass(frozen=True, kw_only=True)
class ViewTurns:
    """What V views show of N columns.

    Attributes:
        sigmas: (2, V, N) of either side in each view, in units of its scatter at random columns.
        weight: (V, N) from 0 to 1.
    """

    sigmas: FloatArray
    weight: FloatArray

    @property
    def sides(self) -> FloatArray:
        """(2, N) sigmas of all views together, none of which counts beyond `MOST_SIGMAS`."""
        clipped = self.sigmas.clip(-MOST_SIGMAS, MOST_SIGMAS)
        total = (clipped * self.weight).sum(axis=1)
        return np.asarray(total / np.sqrt(np.maximum((self.weight**2).sum(axis=0), FEWEST_VIEWS)))

    @property
    def median(self) -> FloatArray:
        """(N,) sigmas of all views together, were each like the median one; 0 without a view.

        Of each view the weaker side counts, so what a few views show by themselves does not.
        """
        shown = self.weight > SEEN
        sign = np.sign(self.sides[0])
        weaker = np.where(shown, (sign * self.sigmas).min(axis=0), np.nan)
        seen = shown.any(axis=0)
        typical = np.zeros(len(sign))
        typical[seen] = np.nanmedian(weaker[:, seen], axis=0)
        joined = np.sqrt(2 * shown.sum(axis=0)) * typical / MEDIAN_SPREAD
        return np.asarray(sign * np.maximum(joined, 0))

    @property
    def views(self) -> FloatArray:
        """(N,) how many views show a column, by weight."""
        return np.asarray((self.weight**2).sum(axis=0))


def join_sides(first: Sigmas, second: Sigmas) -> Sigmas:
    """(...) sigmas of a turn of which these are those of its sides.

    Either side counts for no more than the other: 0 where they turn in different ways.
    """
    joined: Sigmas = np.maximum(np.minimum(first, second), 0)
    joined += np.minimum(np.maximum(first, second), 0)
    joined *= math.sqrt(2)
    return joined


@dataclass(frozen=True, kw_only=True)
class TurnScore:
    """Scores columns; their radius is the distance from the axis to the largest displacement.

    Attributes:
        filters: Of the views.
        view_scatter: (W, L, 2, V) of either side in each view at random columns, by their width
            and height.
        scatter: (W, L, 2) of all views together.
    """

    filters: TurnFilters
    view_scatter: FloatArray
    scatter: FloatArray

    @classmethod
    def calibrated(cls, filters: TurnFilters, places: FloatArray, rng: np.random.Generator) -> Self:
        """With the noise at random columns.

        Args:
            filters: Of the views.
            places: (M, 3) points of the volume that enough views show.
            rng: Draws the columns.
        """
        unit, views = filters.views.unit, len(filters.views)
        shape = (len(WIDTHS_UNITS), len(LENGTHS_UNITS))
        view_scatter, scatter = np.ones((*shape, SIDES, views)), np.ones((*shape, SIDES))
        for w, h in product(*map(range, shape)):
            columns = np.zeros((RANDOM_COLUMNS, 8))
            columns[:, [SLOPE_X, SLOPE_Y]] = rng.normal(0, SLOPE_SIGMA, (RANDOM_COLUMNS, 2))
            columns[:, X : Z + 1] = places[rng.integers(len(places), size=RANDOM_COLUMNS)]
            columns[:, HEIGHT] = LENGTHS_UNITS[h] * unit
            columns[:, RADIUS] = WIDTHS_UNITS[w] * unit
            columns[:, Z] -= columns[:, HEIGHT] / 2
            turns = view_turns(filters, Columns(columns))
            shown = turns.weight > SEEN
            for side, i in product(range(SIDES), range(views)):
                view_scatter[w, h, side, i] = scatter_of(turns.sigmas[side, i, shown[i]])
            by_view = view_scatter[w, h][..., None]
            even = ViewTurns(sigmas=turns.sigmas / by_view, weight=turns.weight)
            enough = even.views >= FEWEST_VIEWS
            scatter[w, h] = [scatter_of(side[enough]) for side in even.sides]
        return cls(filters=filters, view_scatter=view_scatter, scatter=scatter)

    def without(self, *columns: PlumeColumn) -> Self:
        """The same with nothing known inside some columns."""
        if not columns:
            return self
        return replace(self, filters=TurnFilters(reduce(mask_out, columns, self.filters.views)))

    def view_turns(self, columns: Columns) -> ViewTurns:
        """Of each view, in units of its scatter."""
        return self._in_scatter(view_turns(self.filters, columns), columns)

    def _in_scatter(self, turns: ViewTurns, columns: Columns) -> ViewTurns:
        by_view = np.moveaxis(self.view_scatter[self._classes(columns)], 0, -1)
        return ViewTurns(sigmas=turns.sigmas / by_view, weight=turns.weight)

    def __call__(self, columns: Columns) -> FloatArray:
        """(N,) sigmas of all views together, positive where light is bent away from the axis."""
        return self._join(self.view_turns(columns), columns)

    def agreed(self, columns: Columns) -> FloatArray:
        """(N,) as `__call__`, but no more than the views would show were each like the median one.

        The strongest turns without a plume are mostly made by a few views, where a search finds
        them; a plume is in most.
        """
        turns = self.view_turns(columns)
        return self._limit(turns, columns)

    def _limit(self, turns: ViewTurns, columns: Columns) -> FloatArray:
        """(N,) sigmas of all views together, no more than were each like the median one.

        Views err alike, the more the more of them there are: both are in units of the scatter of
        all views together, and less by what views share at the columns that a search finds.
        """
        sigmas = self._join(turns, columns)
        scatter = self.scatter[self._classes(columns)].mean(axis=-1)
        least = np.minimum(np.abs(sigmas), np.abs(turns.median) / scatter)
        return np.asarray(np.sign(sigmas) * least / np.sqrt(1 + SHARED * turns.views))

    def _join(self, turns: ViewTurns, columns: Columns) -> FloatArray:
        return join_sides(*turns.sides / self.scatter[self._classes(columns)].T)

    def unlimited(self, columns: Columns) -> FloatArray:
        """(N,) as the median view shows them, where no place is limited to `MOST_SIGMAS`.

        It tells a plume from what lies beside it: where a plume is strong both reach the limit.
        """
        samples = _sample_axes(self.filters, columns)
        turns = _sum_heights(samples.sigmas, samples.weight, len(columns))
        return self._in_scatter(turns, columns).median

    def expected(self, columns: Columns, size_px: float) -> FloatArray:
        """(N,) sigmas that turns of that size would show on average.

        Args:
            columns: N columns.
            size_px: Of the factor before ``u exp(-u^2 / 2)``, px of the whole frame.
        """
        samples = _sample_axes(self.filters, columns)
        would = np.minimum(size_px * samples.sigmas_per_px, MOST_SIGMAS)
        turns = self._in_scatter(_sum_heights(would, samples.weight, len(columns)), columns)
        return self._limit(turns, columns)

    def _classes(self, columns: Columns) -> tuple[IntArray, IntArray]:
        """Which random columns each column is most like."""
        unit = self.filters.views.unit
        middle = columns.radii + columns.openings * columns.heights / 2
        width = np.abs(np.log(middle[:, None] / unit / WIDTHS_UNITS)).argmin(axis=1)
        height = np.abs(np.log(columns.heights[:, None] / unit / LENGTHS_UNITS)).argmin(axis=1)
        return width, height


def view_turns(filters: TurnFilters, columns: Columns) -> ViewTurns:
    """What the views show of N columns, each height in sigmas of one place."""
    samples = _sample_axes(filters, columns)
    return _sum_heights(samples.limited, samples.weight, len(columns))


def _sample_axes(filters: TurnFilters, columns: Columns) -> TurnSamples:
    """`ALONG` points of each of N axes: one point of every axis after the other."""
    share = (np.arange(ALONG) + 0.5) / ALONG
    heights = columns.heights * share[:, None]
    points = columns.axis_points(heights.T).swapaxes(0, 1).reshape(-1, 3)
    widths = (columns.radii + columns.openings * heights).ravel()
    rises = np.tile(np.column_stack([columns.slopes, np.ones(len(columns))]), (ALONG, 1))
    return filters.sample(points, widths, rises)


def _sum_heights(sigmas: FloatMap, weight: FloatMap, columns: int) -> ViewTurns:
    """The points of each column together; (2, V, ALONG * N) sigmas, (V, ALONG * N) weights."""
    shape = (len(weight), ALONG, columns)
    weights = weight.reshape(shape)
    total = (sigmas.reshape(SIDES, *shape) * weights).sum(axis=2)
    squares = (weights * weights).sum(axis=1)
    return ViewTurns(
        sigmas=total / np.sqrt(np.maximum(squares, 1.0)), weight=np.sqrt(squares / ALONG)
    )
