"""All that the views of a run show: the plumes, and what would have been seen."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from detect.registry import DetectorChoice
from detect.response import Response
from geometry.grid import EvidenceGrid
from locate.fusion.fuse import FusionResult, fuse, number_plumes
from locate.fusion.limit import detection_limit_px
from locate.fusion.matched.plumes import TurnSearch
from locate.fusion.views import Views
from locate.map.plume import Plume

UNSURE = (0.2, 0.999)
"""Probability of a column between which more frames may change whether it is a plume, or where.
Of 70 recordings without a plume 23 leave doubt, of 140 with one 118 (docs/weak_plumes.md)."""
FUSION_SHARE = 0.6
"""Share of the time that fusing the evidence of pixels takes, for the progress."""


@dataclass(frozen=True, kw_only=True)
class FoundPlumes:
    """What the views of a run show.

    Attributes:
        plumes: Strongest first.
        by_pixels: What the evidence of pixels alone shows.
        unconfirmed: How many of its plumes are none by the displacement.
        turns: The search for turns of the displacement, where there was one.
        limit_px: The detection limit, px of the original frames; None where nothing would have
            been seen.
        rejected: Probability of the likeliest column that is not reported, 0 without one.
    """

    plumes: tuple[Plume, ...]
    by_pixels: FusionResult
    unconfirmed: int
    turns: TurnSearch | None
    limit_px: float | None
    rejected: float = 0.0

    @property
    def grid(self) -> EvidenceGrid | None:
        """The summed evidence of pixels; None where no frame measured any depth."""
        return self.by_pixels.grid

    @property
    def threshold_nats(self) -> float:
        """What a column needs of that evidence."""
        return self.by_pixels.threshold_nats

    @property
    def is_unsure(self) -> bool:
        """Whether the displacement of more frames may change what is found, or where."""
        if self.turns is None:
            return False
        weakest = min((plume.probability for plume in self.plumes), default=self.rejected)
        low, high = UNSURE
        return low <= weakest < high or (self.limit_px is None and not self.plumes)


def find_plumes(
    views: Views,
    detector: DetectorChoice,
    *,
    response: Response | None = None,
    by_pixels: FusionResult | None = None,
    seed: int = 0,
    progress: Callable[[float], None] = lambda _share: None,
) -> FoundPlumes:
    """Finds the plumes by the evidence of pixels and by the turn of the displacement.

    Args:
        views: Of the run.
        detector: That measured them.
        response: Of the detector, for the detection limit; None: the hand-made formula.
        by_pixels: What the evidence of pixels of these views shows, where it is known.
        seed: Of every random choice.
        progress: Receives the share done, from 0 to 1.
    """
    # 1. Columns in which the evidence of pixels adds up.
    pixels = views.by_pixels
    # Their displacement is not needed yet: masking it would cost more than masking the evidence.
    fused = by_pixels or fuse(
        pixels.with_evidence(pixels.llr, ()),
        seed=seed,
        progress=lambda share: progress(FUSION_SHARE * share),
        least_nats=detector.clutter_nats * len(pixels),
    )
    # 2. Those about which the displacement turns, and what turns alone show.
    rng = np.random.default_rng(seed)
    turns = None if fused.grid is None else TurnSearch.of_views(views, fused.grid, rng)
    if turns is None:
        plumes = [cap_probability(each, detector, len(pixels)) for each in fused.plumes]
        unconfirmed, rejected = 0, 0.0
    else:
        confirmed = turns.confirm(fused.plumes, rng)
        others = turns.find_plumes(confirmed.plumes, rng)
        plumes = confirmed.plumes + others.plumes
        unconfirmed = len(fused.plumes) - len(confirmed.plumes)
        rejected = max(confirmed.rejected, others.rejected)
    # 3. What would have been seen.
    limit_px = None
    if fused.grid is not None:
        limit_px = detection_limit_px(
            views, fused.threshold_nats, response=response, seed=seed, turns=turns
        )
    progress(1.0)
    return FoundPlumes(
        plumes=number_plumes(plumes),
        by_pixels=fused,
        unconfirmed=unconfirmed,
        turns=turns,
        limit_px=limit_px,
        rejected=rejected,
    )


def cap_probability(plume: Plume, detector: DetectorChoice, views: int) -> Plume:
    """The plume, no surer than plumes with as much evidence a view are true.

    A network errs alike from all sides, which the draws of chance do not show.
    """
    if detector.reliability is None:
        return plume
    most = detector.reliability.true_share(plume.evidence_nats, views)
    return replace(plume, probability=min(plume.probability, most))
