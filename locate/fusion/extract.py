"""The plumes among columns that were fitted to the evidence, each with the others masked out."""

from collections.abc import Iterable, Sequence
from functools import partial, reduce

import numpy as np

from locate.fusion.axis.pairs import split_column
from locate.fusion.search.columns import Columns, PlumeColumn
from locate.fusion.search.fit import ALL_ROUNDS, FINE_ROUNDS, random_search
from locate.fusion.search.null import NullLevel
from locate.fusion.search.score import column_evidence, mask_out
from locate.fusion.source.measure import find_axis, measure_plume
from locate.fusion.views import Views
from locate.map.plume import Plume

FAR_UNITS = 1.0
"""A column farther than this from a plume, units of fusion, is not what that plume left; chosen."""
KEPT_SHARE = 0.5
"""Share of its evidence that a stronger column must keep once another is masked out; otherwise the
other is no plume. Set on four flights of the simulated campaign (docs/archive/tried.md)."""
SAME_PLACE_UNITS = 0.2
"""Sources nearer than this, units of fusion, are one plume's; chosen by hand."""
PAIR_STRENGTH = 2
"""What the evidence of either plume of a pair counts: that something is there, both have shown."""


def extract_plumes(
    views: Views,
    columns: Iterable[PlumeColumn],
    null: NullLevel,
    level: float,
    rng: np.random.Generator,
) -> tuple[list[Plume], Views]:
    """The plumes among the columns, and the views without what those explain.

    Two columns may hold the same plume, one of them beside another: it is taken once.

    Args:
        views: The evidence.
        columns: Strongest contrast first.
        null: What chance makes.
        level: What a plume needs, nats.
        rng: Of the searches.
    """
    kept = suppress_overlaps(views, columns, level, rng)
    plumes: list[Plume] = []
    for k, column in enumerate(kept):
        stronger_masked = reduce(mask_out, kept[:k], views)
        others_masked = reduce(mask_out, kept[k + 1 :], stronger_masked)
        found = split_pair(
            split_column(others_masked, column, rng), others_masked, null, level, rng
        )
        if not found:
            found = single_plume(column, others_masked, stronger_masked, null, level, rng)
        plumes += drop_known(found, plumes, views.unit)
    return plumes, reduce(mask_out, kept, views)


def suppress_overlaps(
    views: Views,
    columns: Iterable[PlumeColumn],
    level: float,
    rng: np.random.Generator,
) -> list[PlumeColumn]:
    """The columns above the level once those before them are masked out, strongest first.

    A column is left out where a stronger one has less than `KEPT_SHARE` of its evidence once that
    column is masked out: both hold the same.
    """
    masked, above = views, []
    for column in columns:
        _, nats = random_search(
            partial(column_evidence, masked), column.as_columns, views.unit, rng
        )
        if nats[0] >= level:
            above.append(column)
            masked = mask_out(masked, column)
    kept: list[PlumeColumn] = []
    for column in sorted(above, key=lambda each: -_nats_of(views, each)):
        if not _steals_evidence(views, column, kept):
            kept.append(column)
    return kept


def _steals_evidence(views: Views, column: PlumeColumn, others: Sequence[PlumeColumn]) -> bool:
    """Whether any of the others loses too much of its evidence with the column masked out."""
    masked = mask_out(views, column)
    return any(_nats_of(masked, other) < KEPT_SHARE * _nats_of(views, other) for other in others)


def _nats_of(views: Views, column: PlumeColumn) -> float:
    return float(column_evidence(views, column.as_columns)[0])


def split_pair(
    pair: Sequence[tuple[PlumeColumn, Views]],
    both: Views,
    null: NullLevel,
    level: float,
    rng: np.random.Generator,
) -> list[Plume]:
    """The two plumes that one column held; none where one of them is none, or both are the same.

    Each needs half of what a plume alone does, as that something is there was shown by both; and
    where each is is known already, nearly.

    Args:
        pair: As of `split_column`.
        both: The views in which neither is masked out.
        null: What chance makes.
        level: What a plume alone needs, nats.
        rng: Of the search.
    """
    found: list[Plume] = []
    for column, other_masked in pair:
        strength = PAIR_STRENGTH * _nats_of(both, column)
        measured = find_axis(other_masked, column, rng, rounds=FINE_ROUNDS)
        if strength < level or measured is None:
            return []
        plume = measure_plume(other_masked, *measured, null.false_alarm(strength))
        if not drop_known([plume], found, both.unit):
            return []
        found.append(plume)
    return found


def single_plume(
    column: PlumeColumn,
    others_masked: Views,
    stronger_masked: Views,
    null: NullLevel,
    level: float,
    rng: np.random.Generator,
    *,
    rounds: range = ALL_ROUNDS,
) -> list[Plume]:
    """The plume that a column is; none where it is none.

    Args:
        column: The column.
        others_masked: The views with every other column masked out, in which it is measured.
        stronger_masked: Those with the stronger ones masked out, in which it must reach the level.
        null: What chance makes.
        level: What a plume needs, nats.
        rng: Of the search.
        rounds: Of the search: fewer stay nearer.
    """
    measured = find_axis(others_masked, column, rng, rounds=rounds)
    if measured is None or (strength := _nats_of(stronger_masked, measured[0])) < level:
        return []
    return [measure_plume(others_masked, *measured, null.false_alarm(strength))]


def drop_known(plumes: Iterable[Plume], known: Sequence[Plume], unit: float) -> list[Plume]:
    """The plumes whose source is not that of a known one."""
    return [plume for plume in plumes if not _is_known(plume, known, unit)]


def _is_known(plume: Plume, known: Iterable[Plume], unit: float) -> bool:
    return any(
        np.linalg.norm(plume.source - other.source) < SAME_PLACE_UNITS * unit for other in known
    )


def find_far_columns(
    views: Views, columns: Columns, plumes: Sequence[Plume], least_nats: float
) -> list[PlumeColumn]:
    """Strong columns too far from every plume to be what it left of its evidence.

    Args:
        views: The evidence with the plumes masked out.
        columns: All that were fitted.
        plumes: Those found.
        least_nats: What a column must have left.
    """
    places = np.reshape([plume.source[:2] for plume in plumes], (-1, 2))
    apart = np.linalg.norm(columns.lowest_points[:, None, :2] - places, axis=2)
    far = columns.take(apart.min(axis=1, initial=np.inf) > FAR_UNITS * views.unit)
    return list(far.take(column_evidence(views, far) >= least_nats))
