"""The whole of fusion: evidence of many views in, plumes out."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial, reduce

import numpy as np

from geometry.arrays import FloatArray
from geometry.grid import EvidenceGrid, VoxelBox
from locate.fusion.extract import drop_known, extract_plumes, find_far_columns
from locate.fusion.joint import JointColumns, measure_together
from locate.fusion.search.columns import Columns
from locate.fusion.search.fit import SEARCH_GAIN, fit_columns
from locate.fusion.search.null import FALSE_ALARM, NullLevel
from locate.fusion.search.proposals import MOST_PROPOSALS, propose_columns
from locate.fusion.search.score import column_contrast, column_evidence, mask_out
from locate.fusion.views import Views
from locate.map.plume import Plume

NULL_SHARE = 0.8
"""Share of fusion's time that the draws of chance take, for the progress that is reported."""
JOINT_STREAM = 1
"""Of the random numbers of the joint search, so that those of the rest are the same without it."""
REMNANT_SHARE = 0.1
"""Share of a plume's evidence that columns beside it may keep once it is masked out; chosen by
hand."""


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

    A strong plume makes the columns of chance strong too, so the level is drawn again once it is
    found and masked out. Columns far from it that reach the new level are plumes as well if they
    have at least a tenth of its evidence; weaker ones may be what masking left of it. Where
    `least_nats` states what clutter makes, all far columns above it are masked out of that draw.
    Where there is a plume, and columns fitted together are more, they are taken instead
    (`JointColumns`).

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
    threshold = _Threshold(
        box=views.volume(), rng=rng, most_false_alarm=most_false_alarm, least_nats=least_nats
    )
    # Columns: proposed by the summed grid, then fitted until they stand out most.
    proposals, grid = propose_columns(views, views.volume(), most=MOST_PROPOSALS)
    fit = partial(fit_columns, partial(column_contrast, views), proposals.columns, views.unit)

    def weakest_nats() -> float:
        # A search of its own: without it the random numbers that follow are the same.
        columns = fit(np.random.default_rng(seed))
        return weakest_candidate(column_evidence(views, columns), least_nats)

    chance = null
    if chance is None:
        chance = threshold.draw_null(
            views, lambda share: progress(NULL_SHARE * share), weakest_nats
        )
    level_nats = threshold.nats(chance)
    columns = fit(rng)
    plumes, masked = extract_plumes(views, columns, chance, level_nats, rng)
    if null is None:
        plumes, level_nats = _add_far_plumes(
            plumes, columns, views=views, masked=masked, threshold=threshold, level_nats=level_nats
        )
        if plumes:
            plumes, level_nats = _try_jointly(
                plumes,
                columns,
                views,
                threshold,
                level_nats,
                np.random.default_rng([seed, JOINT_STREAM]),
            )
    progress(1.0)
    return FusionResult(plumes=number_plumes(plumes), grid=grid, threshold_nats=level_nats)


@dataclass(frozen=True, kw_only=True)
class _Threshold:
    """What a column needs to count as a plume: more than chance makes, and than clutter does.

    Attributes:
        box: The volume.
        rng: Of the draws of chance.
        most_false_alarm: As of `fuse`.
        least_nats: Likewise.
    """

    box: VoxelBox
    rng: np.random.Generator
    most_false_alarm: float
    least_nats: float

    def draw_null(
        self,
        views: Views,
        progress: Callable[[float], None] = lambda _share: None,
        weakest_nats: Callable[[], float] = lambda: 0.0,
    ) -> NullLevel:
        """What chance makes of these views, as of `NullLevel.from_views`."""
        return NullLevel.from_views(
            views,
            self.box,
            self.rng,
            progress=progress,
            most_false_alarm=self.most_false_alarm,
            least_nats=self.least_nats,
            weakest_nats=weakest_nats,
        )

    def nats(self, null: NullLevel) -> float:
        """The evidence that a column needs."""
        return max(null.threshold(self.most_false_alarm), self.least_nats)


def _add_far_plumes(
    plumes: list[Plume],
    columns: Columns,
    *,
    views: Views,
    masked: Views,
    threshold: _Threshold,
    level_nats: float,
) -> tuple[list[Plume], float]:
    """The plumes, with those far from them that reach the level drawn without them; and the level.

    Args:
        plumes: Found so far.
        columns: All that were fitted.
        views: The evidence.
        masked: Without what the plumes explain.
        threshold: What a column needs.
        level_nats: That by which the plumes were found.
    """
    least_nats = threshold.least_nats
    strongest_nats = float(column_evidence(views, columns).max(initial=0.0))
    floor_nats = max(least_nats, REMNANT_SHARE * strongest_nats)
    far = find_far_columns(masked, columns, plumes, floor_nats)
    may_fall = bool(plumes) and level_nats > least_nats
    if not may_fall and not (far and (plumes or least_nats)):
        return plumes, level_nats
    remaining = reduce(mask_out, far, masked) if least_nats else masked
    null = threshold.draw_null(remaining)
    level_nats = threshold.nats(null)
    more, _ = extract_plumes(masked, far, null, max(level_nats, floor_nats), threshold.rng)
    return plumes + drop_known(more, plumes, views.unit), level_nats


def _try_jointly(
    plumes: list[Plume],
    columns: Columns,
    views: Views,
    threshold: _Threshold,
    level_nats: float,
    rng: np.random.Generator,
) -> tuple[list[Plume], float]:
    """The plumes, or those that columns fitted together are, where these are more; and the level.

    Where none is found one by one this finds clutter on real frames (docs/accuracy.md).

    Args:
        plumes: Found one by one, at least one.
        columns: All that were fitted.
        views: The evidence.
        threshold: What a column needs.
        level_nats: That by which the plumes were found.
        rng: Of the searches.
    """
    strong_nats = threshold.least_nats or level_nats
    together = JointColumns.search(views, columns, threshold.box, rng, least_nats=strong_nats)
    if len(together) <= len(plumes):
        return plumes, level_nats
    candidates = together.candidates(threshold.least_nats)
    if len(candidates) <= len(plumes):
        return plumes, level_nats
    rest = together.all_masked()
    null = replace(threshold, rng=rng).draw_null(rest)
    found = measure_together(candidates, null, rest.correlation_px2, threshold.nats, rng)
    if len(found) <= len(plumes):
        return plumes, level_nats
    return found, threshold.nats(null.scaled(rest.correlation_px2 / views.correlation_px2))


def weakest_candidate(strengths: FloatArray, least_nats: float) -> float:
    """Evidence of the weakest column that may be a plume, at least the floor, nats.

    A search may still find more in a column than it has, so those nearly as strong as the floor
    count.

    Args:
        strengths: (N,) evidence of the columns, nats.
        least_nats: The floor; with none, any column may be a plume.
    """
    candidates = strengths[SEARCH_GAIN * strengths >= least_nats]
    return max(least_nats, float(candidates.min())) if len(candidates) else least_nats


def number_plumes(plumes: Sequence[Plume]) -> tuple[Plume, ...]:
    """The plumes by their evidence, strongest first, numbered from 1."""
    ranked = sorted(plumes, key=lambda plume: -plume.evidence_nats)
    return tuple(replace(plume, id=number) for number, plume in enumerate(ranked, start=1))
