"""How strong a column chance alone makes: the run's own maps with their agreement destroyed.

Every view's maps are turned sideways by a random amount of their own, so that each still holds
what it held (noise, clutter, blobs) but no two views agree on where. The strongest column of
each such draw is a sample of the largest value in the whole volume, so the level holds for the
volume, not for a voxel.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache, partial
from typing import Self

import numpy as np

from geometry.arrays import FloatArray
from geometry.grid import VoxelBox
from locate.fusion.search.fit import fit_columns
from locate.fusion.search.proposals import MOST_PROPOSALS, propose_columns
from locate.fusion.search.score import column_evidence
from locate.fusion.views import Views

NULL_DRAWS = 12
"""Most volumes drawn; chosen by hand: each takes as long as the search itself."""
FEWEST_DRAWS = 4
"""Volumes after which the draws may end; chosen by hand."""
CLEAR_FACTOR = 1.5
"""They end where this many times the level is below the floor or every column; chosen by hand."""
FALSE_ALARM = 0.01
"""Probability that a volume without plumes yields one; chosen by hand."""
SMALLEST_SHIFT = 0.12
"""Least turn of a view's maps, in their widths: less leaves some agreement; chosen by hand."""
SMALLEST_SCALE_NATS = 1.0
"""Least scale of the Gumbel distribution, for draws that are alike by luck; chosen by hand."""


@dataclass(frozen=True, kw_only=True)
class NullLevel:
    """The distribution of the strongest column of a volume without plumes.

    Attributes:
        strongest: (D,) the strongest column of each draw, nats.
        location: Of the Gumbel distribution fitted to them.
        scale: Likewise.
    """

    strongest: FloatArray
    location: float
    scale: float

    @classmethod
    def from_views(
        cls,
        views: Views,
        box: VoxelBox,
        rng: np.random.Generator,
        *,
        progress: Callable[[float], None],
        most_false_alarm: float = FALSE_ALARM,
        least_nats: float = 0.0,
        weakest_nats: Callable[[], float] = lambda: 0.0,
    ) -> Self:
        """Draws volumes from the run's own maps.

        Fewer than `NULL_DRAWS` are enough where the level is far below a floor that holds anyway,
        or below all columns that it may decide on.

        Args:
            views: The evidence.
            box: The volume.
            rng: Of the draws.
            progress: Receives the share done.
            most_false_alarm: What the level is of.
            least_nats: The floor; 0 without one.
            weakest_nats: Evidence of the weakest column that may be a plume; called at most once,
                and not where the floor decides.
        """
        weakest = cache(weakest_nats)
        strongest: list[float] = []
        while len(strongest) < NULL_DRAWS:
            progress(len(strongest) / NULL_DRAWS)
            strongest.append(draw_strongest(views, box, rng))
            if len(strongest) >= FEWEST_DRAWS:
                level = cls.from_draws(strongest).threshold(most_false_alarm)
                if CLEAR_FACTOR * level < least_nats or CLEAR_FACTOR * level < weakest():
                    break
        return cls.from_draws(strongest)

    @classmethod
    def from_draws(cls, strongest: Sequence[float]) -> Self:
        """The Gumbel distribution with the mean and deviation of the draws."""
        draws = np.asarray(strongest, dtype=float)
        scale = max(float(draws.std(ddof=1)) * np.sqrt(6) / np.pi, SMALLEST_SCALE_NATS)
        location = float(draws.mean() - np.euler_gamma * scale)
        return cls(strongest=draws, location=location, scale=float(scale))

    def scaled(self, factor: float) -> Self:
        """The same for evidence that is counted in other samples: `factor` times the nats."""
        return self.from_draws([factor * nats for nats in self.strongest])

    def false_alarm(self, strength: float) -> float:
        """Probability that a volume without plumes holds a column at least this strong."""
        return float(-np.expm1(-np.exp((self.location - strength) / self.scale)))

    def threshold(self, false_alarm: float) -> float:
        """The strength that only the share `false_alarm` of such volumes reaches, nats."""
        return float(self.location - self.scale * np.log(-np.log1p(-false_alarm)))


def draw_strongest(views: Views, box: VoxelBox, rng: np.random.Generator) -> float:
    """The strongest column of one volume in which the views agree on nothing, nats."""
    width = views.llr.shape[2]
    shares = rng.uniform(SMALLEST_SHIFT, 1 - SMALLEST_SHIFT, size=len(views))
    rolled = views.rolled_sideways([round(share * width) for share in shares])
    proposals, _ = propose_columns(rolled, box, most=MOST_PROPOSALS)
    columns = fit_columns(partial(column_evidence, rolled), proposals.columns, views.unit, rng)
    return float(column_evidence(rolled, columns.take(slice(1))).max(initial=0.0))
