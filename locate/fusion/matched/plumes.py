"""The plumes that the turn of the displacement shows where pixels alone show too little."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Self

import numpy as np

from detect.kinds import CLUTTER_NATS
from geometry.grid import EvidenceGrid
from locate.fusion.axis.estimate import AxisEstimate
from locate.fusion.extract import FAR_UNITS
from locate.fusion.matched.evidence import with_turn_evidence
from locate.fusion.matched.filters import TurnFilters
from locate.fusion.matched.fit import Turn, agreed_sigmas, find_turns, strongest_turn_near
from locate.fusion.matched.probability import LEAST_PROBABILITY, ColumnStrength
from locate.fusion.matched.scan import SHOWN_PLACE, propose_turns
from locate.fusion.matched.score import TurnScore
from locate.fusion.search.columns import Columns, PlumeColumn, X, Y
from locate.fusion.search.fit import ALL_ROUNDS, random_search
from locate.fusion.search.score import column_evidence
from locate.fusion.source.measure import REFRACTIVE_INDEX, find_axis, measure_plume
from locate.fusion.views import Views
from locate.map.plume import Plume

LEAST_SIGMAS = 6.0
"""Weaker turns are not looked at; chosen by hand."""
RADIUS_WIDTHS = 2.5
"""Radius of a plume, in distances from its axis to the largest displacement; chosen by hand."""
STARTS, START_UNITS = 12, 0.1
"""Columns from which the evidence of pixels near a turn is sought, and how far they lie from it,
units of fusion; chosen by hand."""
PIXEL_ROUNDS = ALL_ROUNDS[8:14]
"""Of that search: it begins with small steps; chosen by hand."""
SAME_AXIS_UNITS, SAME_STRONG_AXIS_UNITS = 0.3, 0.8
"""Within how many units of fusion of a turn the axis by pixels is that of the same plume: where
these have less evidence than clutter may, and where they have more. The first was set on two plumes
of weak pixels, the second on seven of strong ones (docs/weak_plumes.md)."""
AXIS_TRIES = 4
"""How often an axis is searched for: the columns that weak evidence fits best are far too wide at
times; chosen by hand."""
MOSTLY_EMPTY = 0.5
"""Share of the views without evidence of pixels above which the axis is the turn's own: sections of
single views place it worse then. Set on six places of one recording (docs/weak_plumes.md)."""


@dataclass(frozen=True, kw_only=True)
class Decision:
    """Which columns are plumes, and how near the others came.

    Attributes:
        plumes: That are reported.
        rejected: Probability of the likeliest column that is not, 0 without one.
    """

    plumes: list[Plume]
    rejected: float


@dataclass(frozen=True, kw_only=True)
class TurnSearch:
    """The displacement of all views, ready to be searched for turns.

    Attributes:
        score: Of columns.
        grid: Says how many views show each voxel.
    """

    score: TurnScore
    grid: EvidenceGrid

    @classmethod
    def of_views(cls, views: Views, grid: EvidenceGrid, rng: np.random.Generator) -> Self | None:
        """None where no view has information, or too few show any place."""
        places = grid.box.centers_in_world(np.argwhere(grid.weight >= SHOWN_PLACE).astype(float))
        if not views.information or not len(places):
            return None
        return cls(score=TurnScore.calibrated(TurnFilters(views), places, rng), grid=grid)

    def confirm(self, plumes: Sequence[Plume], rng: np.random.Generator) -> Decision:
        """Those of the plumes about which the displacement turns too, by their evidence.

        Args:
            plumes: Found by the evidence of pixels.
            rng: Of the searches.
        """
        score, kept, rejected = self.score, list[Plume](), 0.0
        for plume in sorted(plumes, key=lambda each: -each.evidence_nats):
            sure = strength_of_plume(score, plume, rng).probability
            if sure >= LEAST_PROBABILITY:
                kept.append(replace(plume, probability=min(plume.probability, sure)))
                # What another plume explains must not support this one.
                score = score.without(column_of(plume))
            else:
                rejected = max(rejected, sure)
        return Decision(plumes=kept, rejected=rejected)

    def find_turns(self, rng: np.random.Generator) -> list[Turn]:
        """The distinct columns about which the displacement turns, the surest first."""
        return find_turns(self.score, propose_turns(self.score.filters, self.grid), rng)

    def find_plumes(self, known: Sequence[Plume], rng: np.random.Generator) -> Decision:
        """The plumes that are not known yet, the surest first.

        Args:
            known: Plumes found by the evidence of pixels.
            rng: Of the searches.
        """
        unit = self.score.filters.views.unit
        # What another plume explains must not support this one.
        score = self.score.without(*map(column_of, known))
        found, rejected = list[Plume](), 0.0
        for turn in self.find_turns(rng):
            if abs(turn.sigmas) < LEAST_SIGMAS:
                break
            strength = strength_of_turn(score, turn, rng)
            if strength.probability < LEAST_PROBABILITY:
                rejected = max(rejected, strength.probability)
                continue
            plume = _measure_turn(score, turn, strength, rng)
            if plume is None:
                rejected = max(rejected, strength.probability)
            elif not is_near(plume, [*known, *found], unit):
                found.append(plume)
                score = score.without(turn.column.widened(RADIUS_WIDTHS), column_of(plume))
        return Decision(plumes=found, rejected=rejected)


def column_of(plume: Plume) -> PlumeColumn:
    """The column that a plume fills."""
    low, high = plume.extent_low, plume.extent_high
    radii = np.interp([low, high], *plume.radius_by_height.T)
    height = (high - low) * plume.axis[2]
    slopes = plume.axis[:2] / plume.axis[2]
    opening = (radii[1] - radii[0]) / height if height else 0.0  # it may be seen at one height
    lowest = plume.points_on_axis(np.array([low]))[0]
    return PlumeColumn(np.array([*lowest, *slopes, height, radii[0], opening]))


def strength_of_plume(score: TurnScore, plume: Plume, rng: np.random.Generator) -> ColumnStrength:
    """What the column of a plume shows that was found by the evidence of pixels."""
    narrow = column_of(plume).widened(1 / RADIUS_WIDTHS)
    return ColumnStrength(
        sigmas=strongest_turn_near(score, narrow, rng),
        nats_per_view=plume.evidence_nats / len(score.filters.views.by_pixels),
    )


def strength_of_turn(score: TurnScore, turn: Turn, rng: np.random.Generator) -> ColumnStrength:
    """What a column shows about which the displacement turns."""
    pixels = score.filters.views.by_pixels
    pixel_nats = _most_evidence(pixels, turn.column.widened(RADIUS_WIDTHS), rng)
    return ColumnStrength(
        sigmas=agreed_sigmas(score, turn, rng), nats_per_view=pixel_nats / len(pixels)
    )


def _measure_turn(
    score: TurnScore, turn: Turn, strength: ColumnStrength, rng: np.random.Generator
) -> Plume | None:
    """The plume about whose axis the displacement turns; None where no axis can be measured."""
    views, column = score.filters.views, turn.column.widened(RADIUS_WIDTHS)
    turn = replace(turn, sigmas=float(score(turn.column.as_columns)[0]))
    filled = with_turn_evidence(views, turn)
    measured = _try_axis(filled, column, rng)
    weak = strength.nats_per_view < CLUTTER_NATS
    near = SAME_AXIS_UNITS if weak else SAME_STRONG_AXIS_UNITS
    on_turn = bool(np.mean(~views.by_pixels.llr.any(axis=(1, 2))) > MOSTLY_EMPTY)
    if measured is None or turn.column.widest_gap_to(measured[0]) > near * views.unit:
        # The evidence of pixels shows no axis, or lies elsewhere: that for the turn counts alone.
        filled = with_turn_evidence(views.with_evidence(np.zeros_like(views.llr)), turn)
        measured = _try_axis(filled, column, rng) or measured
        on_turn = True
    if measured is None:
        return None
    plume = measure_plume(filled, *join_turn(*measured, turn, on_turn), 1 - strength.probability)
    return replace(
        plume,
        evidence_nats=strength.nats_per_view * len(views.by_pixels) + turn.sigmas**2 / 2,
        refractive_index=REFRACTIVE_INDEX[1 if turn.sigmas > 0 else -1],
    )


def _try_axis(
    views: Views, column: PlumeColumn, rng: np.random.Generator
) -> tuple[PlumeColumn, AxisEstimate] | None:
    """As `find_axis`, again where it ends in columns whose axis no view shows."""
    tries = (find_axis(views, column, rng) for _ in range(AXIS_TRIES))
    return next((measured for measured in tries if measured is not None), None)


def join_turn(
    column: PlumeColumn, axis: AxisEstimate, turn: Turn, on_turn: bool
) -> tuple[PlumeColumn, AxisEstimate]:
    """The column and its axis, on the turn's own axis if `on_turn`.

    Two estimates of one variance differ by twice that variance on average, so half of the squared
    difference of the axes is added to the covariance; to that of the turn's own, its spread too.
    """
    rise = axis.lowest - turn.column.lowest_z
    (point,) = turn.column.axis_points(np.array([rise]))
    line = np.concatenate([point[:2], turn.column.slope])
    apart = line - axis.line
    axis = replace(axis, covariance=axis.covariance + np.outer(apart, apart) / 2)
    if not on_turn:
        return column, axis
    move = np.eye(4) + rise * np.eye(4, k=2)
    spread = move @ turn.spread @ move.T
    return column.on_line(line), replace(axis, line=line, covariance=axis.covariance + spread)


def _most_evidence(views: Views, column: PlumeColumn, rng: np.random.Generator) -> float:
    """The most evidence of pixels that a column near this one has, nats."""
    starts = np.repeat(column.array[None], STARTS, axis=0)
    starts[1:, [X, Y]] += rng.normal(0, START_UNITS * views.unit, (STARTS - 1, 2))
    evidence = partial(column_evidence, views)
    _, nats = random_search(evidence, Columns(starts), views.unit, rng, rounds=PIXEL_ROUNDS)
    return float(nats.max())


def is_near(plume: Plume, others: Sequence[Plume], unit: float) -> bool:
    """Whether its source or its axis is near another's.

    Sources of one plume lie apart where its axis slants and their heights differ.
    """
    return any(
        min(
            float(np.linalg.norm((plume.source - other.source)[:2])),
            column_of(plume).gap_to(column_of(other)),
        )
        < FAR_UNITS * unit
        for other in others
    )
