"""The whole of fusion: evidence of many views in, plumes out."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial, reduce

import numpy as np

from geometry.arrays import FloatArray
from geometry.grid import EvidenceGrid
from locate.fusion.extract import drop_known, extract_plumes, find_far_columns
from locate.fusion.search.columns import Columns
from locate.fusion.search.fit import fit_columns
from locate.fusion.search.null import CLEAR_FACTOR, FALSE_ALARM, NullLevel
from locate.fusion.search.proposals import MOST_PROPOSALS, propose_columns
from locate.fusion.search.score import column_contrast, column_evidence, mask_out
from locate.fusion.views import Views
from locate.map.plume import Plume

NULL_SHARE = 0.8
"""Share of fusion's time that the draws of chance take, for the progress that is reported."""
GHOST_SHARE = 0.1
"""What a plume leaves may have up to this share of its evidence, for the views agree on it by
themselves; chosen by hand."""


@dataclass(frozen=True, kw_only=True)
class FusionResult:
    """What fusion found.

    Attributes:
        plumes: Strongest first.
        grid: The summed evidence; None where no frame measured any depth.
        threshold_nats: What a column needs to count as a plume, those found masked out.
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
    """Finds the plumes that the summed evidence of all views supports.

    A strong plume makes strong chance columns too. Once it is found and masked out, the level is
    drawn anew. A column far from it may pass that with a tenth of its evidence at least, as what is
    left of a strong plume agrees by itself. Several strong ones can hide each other so: where
    `least_nats` states what clutter makes, all above that are masked out of the draws.

    Args:
        views: The evidence.
        seed: Of every random choice.
        progress: Receives the share done, from 0 to 1.
        null: What chance makes of these views; drawn from them where it is not known yet.
        most_false_alarm: Columns that chance makes more often than this are no plumes.
        least_nats: Weaker columns are none either, whatever chance makes.
    """
    if np.isnan(views.unit):
        return FusionResult(plumes=(), grid=None, threshold_nats=np.inf)
    rng = np.random.default_rng(seed)
    draw_null = partial(
        NullLevel.from_views,
        box=views.volume(),
        rng=rng,
        most_false_alarm=most_false_alarm,
        least_nats=least_nats,
    )
    drawn = null is None
    proposals, grid = propose_columns(views, views.volume(), most=MOST_PROPOSALS)

    def fit_proposals(rng: np.random.Generator) -> Columns:
        contrast = partial(column_contrast, views)
        return fit_columns(contrast, proposals.columns, views.unit, rng)

    def weakest_nats() -> float:
        # A search of its own: without it the random numbers that follow are the same.
        columns = fit_proposals(np.random.default_rng(seed))
        return weakest_candidate(column_evidence(views, columns), least_nats)

    # 1. What chance makes of these views: the level that a plume must pass.
    if null is None:
        null = draw_null(
            views,
            progress=lambda share: progress(NULL_SHARE * share),
            weakest_nats=weakest_nats,
        )
    level = max(null.threshold(most_false_alarm), least_nats)

    # 2. Columns: proposed by the summed grid, then fitted until they stand out most.
    columns = fit_proposals(rng)

    # 3. Plumes: the columns above the level, measured with the others masked out.
    plumes, masked = extract_plumes(views, columns, null, level, rng)

    # 4. The columns far from those plumes that may be plumes too.
    strongest = float(column_evidence(views, columns).max(initial=0.0))
    floor = max(least_nats, GHOST_SHARE * strongest)
    far = find_far_columns(masked, columns, plumes, floor)

    # 5. The level without the plumes found, and the far columns held against it.
    raised = bool(plumes) and level > least_nats
    if drawn and (raised or (far and (plumes or least_nats))):
        calm = reduce(mask_out, far, masked) if least_nats else masked
        null = draw_null(calm, progress=lambda _share: None)
        level = max(null.threshold(most_false_alarm), least_nats)
        more, _ = extract_plumes(masked, far, null, max(level, floor), rng)
        plumes += drop_known(more, plumes, views.unit)

    # 6. The answer, strongest first.
    progress(1.0)
    return FusionResult(plumes=number_plumes(plumes), grid=grid, threshold_nats=level)


def weakest_candidate(strengths: FloatArray, least_nats: float) -> float:
    """Evidence of the weakest column that may be a plume, at least the floor, nats.

    A search may still find more in a column than it has, so those nearly as strong as the floor
    count.

    Args:
        strengths: (N,) evidence of the columns, nats.
        least_nats: The floor; with none, any column may be a plume.
    """
    candidates = strengths[CLEAR_FACTOR * strengths >= least_nats]
    return max(least_nats, float(candidates.min())) if len(candidates) else least_nats


def number_plumes(plumes: Sequence[Plume]) -> tuple[Plume, ...]:
    """The plumes by their evidence, strongest first, numbered from 1."""
    ranked = sorted(plumes, key=lambda plume: -plume.evidence_nats)
    return tuple(replace(plume, id=number) for number, plume in enumerate(ranked, start=1))
