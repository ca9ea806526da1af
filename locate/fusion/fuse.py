"""The whole of fusion: evidence of many views in, plumes out."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from functools import partial, reduce

import numpy as np

from geometry.grid import EvidenceGrid
from locate.fusion.axis.pairs import split_column
from locate.fusion.search.columns import Columns, PlumeColumn
from locate.fusion.search.fit import FINE_ROUNDS, fit_columns, random_search
from locate.fusion.search.null import NullLevel
from locate.fusion.search.proposals import MOST_PROPOSALS, propose_columns
from locate.fusion.search.score import column_contrast, column_evidence, mask_out
from locate.fusion.source.measure import find_axis, measure_plume
from locate.fusion.views import Views
from locate.map.plume import Plume

FALSE_ALARM = 0.01
NULL_SHARE = 0.8  # of the time that fusion takes
FAR_UNITS = 1.0
GHOST_SHARE = 0.1
KEPT_SHARE = 0.5
SAME_PLACE_UNITS = 0.2


@dataclass(frozen=True, kw_only=True)
class FusionResult:
    """What fusion found.

    Attributes:
        plumes: Strongest first.
        grid: The summed evidence; None where no frame measured any depth.
        threshold_nats: What a column needs to count as a plume, those found taken out.
    """

    plumes: tuple[Plume, ...]
    grid: EvidenceGrid | None
    threshold_nats: float


def fuse(
    views: Views,
    *,
    seed: int = 0,
    progress: Callable[[float], None] = lambda _share: None,
    null: NullLevel | None = None,
    most_false_alarm: float = FALSE_ALARM,
    least_nats: float = 0.0,
) -> FusionResult:
    """Finds the plumes that the summed evidence of all views speaks for.

    A strong plume makes strong chance columns too. Once it is found and taken out, the level is
    drawn anew. A column that stands far from it may pass that; a tenth of its evidence at least
    must speak for it, as what is left of a strong plume agrees by itself. Several strong ones can
    hide each other so: where `least_nats` says what clutter makes, all above that are taken out of
    the draws.

    Args:
        views: The evidence.
        seed: Of every random choice.
        progress: Told the share done, from 0 to 1.
        null: What chance makes of these views; drawn from them where it is not known yet.
        most_false_alarm: Columns that chance makes more often than this are no plumes.
        least_nats: Weaker columns are none either, whatever chance makes.
    """
    rng = np.random.default_rng(seed)
    if np.isnan(views.unit):
        return FusionResult(plumes=(), grid=None, threshold_nats=np.inf)
    box = views.volume()
    drawn = null is None
    if null is None:
        null = NullLevel.from_views(
            views, box, rng, progress=lambda share: progress(NULL_SHARE * share)
        )
    proposals, grid = propose_columns(views, box, most=MOST_PROPOSALS)
    columns = fit_columns(partial(column_contrast, views), proposals.columns, views.unit, rng)
    level = max(null.threshold(most_false_alarm), least_nats)
    plumes, left = extract_plumes(views, columns, null, level, rng)
    strongest = float(column_evidence(views, columns).max(initial=0.0))
    floor = max(least_nats, GHOST_SHARE * strongest)
    far = find_far_columns(left, columns, plumes, floor)
    raised = bool(plumes) and level > least_nats
    if drawn and (raised or (far and (plumes or least_nats))):
        calm = reduce(mask_out, far, left) if least_nats else left
        null = NullLevel.from_views(calm, box, rng, progress=lambda _share: None)
        level = max(null.threshold(most_false_alarm), least_nats)
        more, _ = extract_plumes(left, far, null, max(level, floor), rng)
        plumes += [plume for plume in more if not is_same_source(plume, plumes, views.unit)]
    progress(1.0)
    plumes.sort(key=lambda plume: -plume.evidence_nats)
    numbered = (replace(plume, id=number) for number, plume in enumerate(plumes, start=1))
    return FusionResult(plumes=tuple(numbered), grid=grid, threshold_nats=level)


def extract_plumes(
    views: Views,
    columns: Iterable[PlumeColumn],
    null: NullLevel,
    level: float,
    rng: np.random.Generator,
) -> tuple[list[Plume], Views]:
    """The plumes among the columns, and the views without what those explain.

    Two columns may hold the same plume, one of them beside another: it is taken once.
    """
    standing = suppress_overlaps(views, columns, level, rng)
    plumes: list[Plume] = []
    for k, column in enumerate(standing):
        stronger = reduce(mask_out, standing[:k], views)
        alone = reduce(mask_out, standing[k + 1 :], stronger)
        found = split_pair(split_column(alone, column, rng), alone, null, level, rng)
        found = found or single_plume(column, alone, stronger, null, level, rng)
        plumes += [plume for plume in found if not is_same_source(plume, plumes, views.unit)]
    return plumes, reduce(mask_out, standing, views)


def suppress_overlaps(
    views: Views,
    columns: Iterable[PlumeColumn],
    level: float,
    rng: np.random.Generator,
) -> list[PlumeColumn]:
    """The columns above the level once those before them are taken out, strongest first.

    One that lives on the evidence of a stronger one is its ghost: without it the other has less
    than `KEPT_SHARE` of its own.
    """
    left, above = views, []
    for column in columns:
        _, nats = random_search(partial(column_evidence, left), column.alone, views.unit, rng)
        if nats[0] >= level:
            above.append(column)
            left = mask_out(left, column)
    standing: list[PlumeColumn] = []
    for column in sorted(above, key=lambda each: -_evidence_of(views, each)):
        rest = mask_out(views, column)
        if all(
            _evidence_of(rest, other) >= KEPT_SHARE * _evidence_of(views, other)
            for other in standing
        ):
            standing.append(column)
    return standing


def _evidence_of(views: Views, column: PlumeColumn) -> float:
    return float(column_evidence(views, column.alone)[0])


def split_pair(
    pair: Sequence[tuple[PlumeColumn, Views]],
    both: Views,
    null: NullLevel,
    level: float,
    rng: np.random.Generator,
) -> list[Plume]:
    """The two plumes that one column held; none where one of them is none, or both are the same.

    Each needs half of what a plume alone does, as that something stands there was shown by both;
    and where each stands is known already, nearly.

    Args:
        pair: As of `split_column`.
        both: The views in which both stand.
        null: What chance makes.
        level: What a plume alone needs, nats.
        rng: Of the search.
    """
    found: list[Plume] = []
    for column, rest in pair:
        strength = 2 * _evidence_of(both, column)
        sighted = find_axis(rest, column, rng, rounds=FINE_ROUNDS)
        if strength < level or sighted is None:
            return []
        plume = measure_plume(rest, *sighted, null.false_alarm(strength))
        if is_same_source(plume, found, rest.unit):
            return []
        found.append(plume)
    return found


def single_plume(
    column: PlumeColumn,
    alone: Views,
    judged: Views,
    null: NullLevel,
    level: float,
    rng: np.random.Generator,
) -> list[Plume]:
    """The plume that a column is; none where it is none.

    Args:
        column: The column.
        alone: The views in which no other plume stands.
        judged: Those in which it must show what a plume does.
        null: What chance makes.
        level: What a plume needs, nats.
        rng: Of the search.
    """
    sighted = find_axis(alone, column, rng)
    if sighted is None or (strength := _evidence_of(judged, sighted[0])) < level:
        return []
    return [measure_plume(alone, *sighted, null.false_alarm(strength))]


def is_same_source(plume: Plume, others: Iterable[Plume], unit: float) -> bool:
    """Whether its source is that of one of the others."""
    return any(
        np.linalg.norm(plume.source - other.source) < SAME_PLACE_UNITS * unit for other in others
    )


def find_far_columns(
    left: Views, columns: Columns, plumes: list[Plume], floor: float
) -> list[PlumeColumn]:
    """Strong columns that stand too far from every plume to be what it left of its evidence."""
    places = np.reshape([plume.source[:2] for plume in plumes], (-1, 2))
    apart = np.linalg.norm(columns.lowest_points[:, None, :2] - places, axis=2).min(
        axis=1, initial=np.inf
    )
    far = columns.take(apart > FAR_UNITS * left.unit)
    return list(far.take(column_evidence(left, far) >= floor))
