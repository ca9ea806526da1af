"""Whether stated probabilities are true: shares with exact intervals, by what was stated."""

import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike
from scipy.stats import binomtest

from benchmarks.common.filmed import FOUND_SHARE
from geometry.atomic import atomic_path

EDGES = (0.0, 0.5, 0.9, 0.99, 0.999, 1.0)
CONFIDENCE = 0.95


@dataclass(frozen=True, kw_only=True)
class Share:
    """So many of so many."""

    hits: int
    count: int

    @classmethod
    def of(cls, true: ArrayLike) -> "Share":
        flags = np.asarray(true, dtype=bool)
        return cls(hits=int(flags.sum()), count=flags.size)

    @property
    def interval(self) -> tuple[float, float]:
        """Of the share, 95 %, exact (Clopper and Pearson 1934); all that is possible of none."""
        if not self.count:
            return 0.0, 1.0
        exact = binomtest(self.hits, self.count).proportion_ci(CONFIDENCE, method="exact")
        return float(exact.low), float(exact.high)

    def __str__(self) -> str:
        low, high = self.interval
        return f"{self.hits} of {self.count} ({100 * low:.0f} to {100 * high:.0f} %)"


@dataclass(frozen=True, kw_only=True)
class ProbabilityBin:
    """What was stated with a probability from `low` to `high`; `stated` is the mean."""

    low: float
    high: float
    stated: float
    true: Share


def binned(
    stated: ArrayLike, true: ArrayLike, edges: Sequence[float] = EDGES
) -> list[ProbabilityBin]:
    """By stated probability, each bin without its lower edge but the first; NaN of an empty one."""
    stated, true = np.asarray(stated, dtype=float), np.asarray(true, dtype=bool)
    place = np.searchsorted(edges[1:-1], stated, side="left")
    bins = []
    for k, (low, high) in enumerate(pairwise(edges)):
        here = place == k
        mean = float(stated[here].mean()) if here.any() else np.nan
        bins.append(ProbabilityBin(low=low, high=high, stated=mean, true=Share.of(true[here])))
    return bins


@dataclass(frozen=True, kw_only=True)
class Stated:
    """Of a column: its evidence, the probability stated of it, how far off it stands in ranges."""

    nats: float
    probability: float
    off: float

    @property
    def near(self) -> bool:
        """Whether it stands where the plume does, or would have stood."""
        return self.off < FOUND_SHARE


NO_COLUMN = Stated(nats=0.0, probability=0.0, off=np.inf)


@dataclass(frozen=True, kw_only=True)
class RecordingOutcome:
    """What was stated of a recording, and what is true of it.

    Attributes:
        amplitude_px: Of its plume, 95th percentile; 0 without one.
        strength_px: Mean displacement within that plume, as the detection limit means it.
        noise: In 1/255.
        views: How many key frames were summed.
        floor_nats: What a column needs whatever chance makes.
        threshold_nats: What a column needed.
        limit_px: The stated detection limit; None where none was stated.
        strongest: The strongest column, searched for as in the draws of chance.
        unasked: The strongest plume that the map would report if nothing were asked of one.
        plumes: What the map reports.
    """

    amplitude_px: float
    strength_px: float
    noise: float
    views: int
    floor_nats: float
    threshold_nats: float
    limit_px: float | None
    strongest: Stated
    unasked: Stated
    plumes: tuple[Stated, ...]

    def true(self, column: Stated) -> bool:
        """Whether a plume stands where the column does."""
        return self.amplitude_px > 0 and column.near

    @property
    def truths(self) -> list[bool]:
        """Of each plume reported, whether it is the one that is there; a second one is not."""
        offs = [plume.off for plume in self.plumes]
        there = self.amplitude_px > 0 and min(offs, default=np.inf) < FOUND_SHARE
        return [there and off == min(offs) for off in offs]

    @property
    def found(self) -> bool:
        return any(self.truths)

    @property
    def over_limit(self) -> float:
        """Strength in units of the stated limit; NaN where none was stated."""
        return np.nan if self.limit_px is None else self.strength_px / self.limit_px

    @classmethod
    def load(cls, path: Path) -> "RecordingOutcome":
        content = json.loads(path.read_text())
        strongest, unasked = (Stated(**content.pop(name)) for name in ("strongest", "unasked"))
        plumes = tuple(Stated(**plume) for plume in content.pop("plumes"))
        return cls(**content, strongest=strongest, unasked=unasked, plumes=plumes)

    def save(self, path: Path) -> None:
        with atomic_path(path) as unfinished:
            unfinished.write_text(json.dumps(asdict(self)))
