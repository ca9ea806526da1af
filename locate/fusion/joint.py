"""Columns found together: what one explains supports no other, whichever was found first.

Plumes that overlap in many views hide each other from a search that takes them one by one, and a
column that crosses several of them may stand out more than any. So columns are proposed in rounds
by what those before leave. Each is fitted again with all others masked out, and one that the others
leave too little of is dropped, be it the first.

Other plumes are no noise either: each column is counted in samples of the evidence in which it is
the only one, as a plume that is alone is.
"""

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import partial
from typing import Self

import numpy as np

from geometry.arrays import BoolArray, FloatArray
from geometry.grid import VoxelBox
from locate.fusion.extract import drop_known, single_plume
from locate.fusion.search.columns import Columns, PlumeColumn
from locate.fusion.search.fit import FINE_ROUNDS, SEARCH_GAIN, fit_columns, random_search
from locate.fusion.search.null import NullLevel
from locate.fusion.search.proposals import MOST_PROPOSALS, SEPARATION_UNITS, propose_columns
from locate.fusion.search.score import column_contrast, column_evidence, explained_pixels
from locate.fusion.source.measure import refine_axis
from locate.fusion.views import Views, correlation_area_of
from locate.map.plume import Plume

FEWEST = 2
"""Columns from which on they are searched for together."""
MOST_ROUNDS = 6
"""Rounds, the first with the columns that it starts from; chosen by hand."""
LEAST_SHARE = 0.1
"""Of the evidence of the strongest column that the others must leave each; chosen by hand."""


@dataclass(eq=False)
class _Member:
    """One of the columns.

    Attributes:
        column: As it was fitted last.
        pixels: (V, H, W) that it explains.
        has_axis: The displacement shows its axis; False in a new one, of which it is not known.
    """

    column: PlumeColumn
    pixels: BoolArray
    has_axis: bool = False


class JointColumns:
    """Columns that are fitted together; none to begin with.

    Args:
        views: The evidence.
    """

    def __init__(self, views: Views) -> None:
        self.views = views
        self._members: list[_Member] = []
        self._without_axis: list[PlumeColumn] = []
        self._explained = np.zeros(views.llr.shape, np.uint8)
        """(V, H, W) by how many columns."""

    @classmethod
    def search(
        cls,
        views: Views,
        starts: Columns,
        box: VoxelBox,
        rng: np.random.Generator,
        *,
        least_nats: float,
    ) -> Self:
        """The columns that the evidence shows, in no order.

        It ends at once where fewer than two of the starts are strong: nothing can hide another.

        Args:
            views: The evidence.
            starts: Columns that were fitted to it one by one.
            box: The volume.
            rng: Of the searches.
            least_nats: Of a strong column.
        """
        together = cls(views)
        if (column_evidence(views, starts) >= least_nats).sum() < FEWEST:
            return together
        together._add(starts)
        together._settle(rng)
        for _ in range(MOST_ROUNDS - 1):
            before, failed = len(together), len(together._without_axis)
            together._add(together._propose(box, rng))
            together._settle(rng)
            if len(together) <= before and len(together._without_axis) == failed:
                break
        return together

    def __len__(self) -> int:
        return len(self._members)

    def all_masked(self) -> Views:
        """The views without what the columns explain, in samples of the evidence that is left."""
        counted = self._explained == 0
        return self._masked(counted, correlation_area_of(self.views.llr, counted))

    def candidates(self, least_nats: float) -> list[tuple[PlumeColumn, Views]]:
        """The columns that may be plumes, strongest first, each with the views of it alone.

        Args:
            least_nats: What a plume needs at least; nearly as much is enough here.
        """
        found = []
        for k in np.argsort(-self._nats(), kind="stable"):
            column, counted = self._members[k].column, self._left_to(self._members[k])
            alone = self._masked(counted, correlation_area_of(self.views.llr, counted))
            if SEARCH_GAIN * column_evidence(alone, column.as_columns)[0] >= least_nats:
                found.append((column, alone))
        return found

    def _propose(self, box: VoxelBox, rng: np.random.Generator) -> list[PlumeColumn]:
        """The columns in what is left, but those known to have no axis."""
        left = self._masked(self._explained == 0)
        proposals, _ = propose_columns(left, box, most=MOST_PROPOSALS)
        fitted = fit_columns(partial(column_contrast, left), proposals.columns, left.unit, rng)
        apart = SEPARATION_UNITS * left.unit
        return [
            column
            for column in fitted
            if all(column.widest_gap_to(other) > apart for other in self._without_axis)
        ]

    def _add(self, columns: Iterable[PlumeColumn]) -> None:
        """Adds those of which the others leave enough; those before may have too little then."""
        for column in columns:
            member = _Member(column, explained_pixels(self.views, column))
            self._members.append(member)
            self._explained += member.pixels
        self._drop_weak()

    def _settle(self, rng: np.random.Generator) -> None:
        """Fits each by what the others leave, and keeps those that have enough, and an axis."""
        for member in self._members:
            left = self._masked(self._left_to(member))
            fitted, _ = random_search(
                partial(column_contrast, left),
                member.column.as_columns,
                left.unit,
                rng,
                rounds=FINE_ROUNDS,
            )
            self._explained -= member.pixels
            member.column, member.pixels = fitted[0], explained_pixels(self.views, fitted[0])
            self._explained += member.pixels
        self._drop_weak()
        self._drop_without_axis()

    def _drop_weak(self) -> None:
        """Drops the column that the others leave least, until all have enough."""
        while self._members:
            nats = self._nats()
            if nats.min() >= LEAST_SHARE * nats.max():
                return
            self._drop(self._members[int(nats.argmin())])

    def _drop_without_axis(self) -> None:
        """Drops the new columns about which the displacement shows no axis."""
        for member in [each for each in self._members if not each.has_axis]:
            left = self._masked(self._left_to(member))
            member.has_axis = refine_axis(left, member.column) is not None
            if not member.has_axis:
                self._drop(member)
                self._without_axis.append(member.column)

    def _drop(self, member: _Member) -> None:
        self._members.remove(member)
        self._explained -= member.pixels

    def _nats(self) -> FloatArray:
        """(N,) evidence that the others leave each, all in the same samples."""
        lefts = (self._masked(self._left_to(member)) for member in self._members)
        return np.array(
            [
                column_evidence(left, member.column.as_columns)[0]
                for left, member in zip(lefts, self._members, strict=True)
            ]
        )

    def _left_to(self, member: _Member) -> BoolArray:
        """(V, H, W) the pixels that no other explains."""
        return np.asarray(self._explained == member.pixels)

    def _masked(self, counted: BoolArray, correlation_px2: float | None = None) -> Views:
        llr = np.where(counted, self.views.llr, np.float32(0))
        return self.views.with_evidence(llr, correlation_px2=correlation_px2)


def measure_together(
    candidates: Iterable[tuple[PlumeColumn, Views]],
    null: NullLevel,
    correlation_px2: float,
    level_nats: Callable[[NullLevel], float],
    rng: np.random.Generator,
) -> list[Plume]:
    """The plumes among columns that were found together, each by what the others leave.

    Args:
        candidates: As of `JointColumns.candidates`.
        null: What chance makes of what all of them leave.
        correlation_px2: Of the samples in which it is counted.
        level_nats: What a plume needs, given what chance makes.
        rng: Of the searches.
    """
    plumes: list[Plume] = []
    for column, alone in candidates:
        chance = null.scaled(correlation_px2 / alone.correlation_px2)
        found = single_plume(
            column, alone, alone, chance, level_nats(chance), rng, rounds=FINE_ROUNDS
        )
        plumes += drop_known(found, plumes, alone.unit)
    return plumes
