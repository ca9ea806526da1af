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
from locate.fusion.matched.probability import true_probability

EDGES = (0.0, 0.2, 0.5, 0.8, 0.95, 1.0)
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


def binned(stated: ArrayLike, true: ArrayLike) -> list[ProbabilityBin]:
    """By stated probability, each bin without its lower edge but the first; NaN of an empty one."""
    stated, true = np.asarray(stated, dtype=float), np.asarray(true, dtype=bool)
    place = np.searchsorted(EDGES[1:-1], stated, side="left")
    bins = []
    for k, (low, high) in enumerate(pairwise(EDGES)):
        here = place == k
        mean = float(stated[here].mean()) if here.any() else np.nan
        bins.append(ProbabilityBin(low=low, high=high, stated=mean, true=Share.of(true[here])))
    return bins


def calibration_error(bins: Sequence[ProbabilityBin]) -> float:
    """Mean difference of what was stated from the share that is true, bins by their size."""
    full = [each for each in bins if each.true.count]
    off = [abs(each.stated - each.true.hits / each.true.count) for each in full]
    return float(np.average(off, weights=[each.true.count for each in full]))


@dataclass(frozen=True, kw_only=True)
class Candidate:
    """A column that may be a plume.

    Attributes:
        sigmas: Of the turn about it.
        nats_per_view: Of its pixels.
        off: How far from the true axis it stands, in ranges.
    """

    sigmas: float
    nats_per_view: float
    off: float

    @property
    def probability(self) -> float:
        return float(true_probability(self.sigmas, self.nats_per_view))


@dataclass(frozen=True, kw_only=True)
class StatedPlume:
    """A plume of the map.

    Attributes:
        probability: As stated.
        off: How far from the true axis it stands, in ranges.
        error: Of its source, in ranges.
        nees: Of its source (3 expected).
    """

    probability: float
    off: float
    error: float
    nees: float


@dataclass(frozen=True, kw_only=True)
class RecordingOutcome:
    """What was stated of a recording, and what is true of it.

    Attributes:
        condition: How it was filmed and stored.
        held_out: Whether it served no choice.
        amplitude_px: Of its plume, 95th percentile; 0 without one.
        strength_px: Mean displacement within that plume, as the detection limit means it.
        limit_px: The stated detection limit; None where none was stated.
        candidates: The columns that were looked at.
        plumes: What the map reports.
    """

    condition: str
    held_out: bool
    amplitude_px: float
    strength_px: float
    limit_px: float | None
    candidates: tuple[Candidate, ...]
    plumes: tuple[StatedPlume, ...]

    def is_true(self, column: Candidate | StatedPlume) -> bool:
        """Whether a plume stands where the column does."""
        return self.amplitude_px > 0 and column.off < FOUND_SHARE

    @property
    def truths(self) -> list[bool]:
        """Of each plume reported, whether it is the one that is there; a second one is not."""
        nearest = min((plume.off for plume in self.plumes), default=np.inf)
        return [self.is_true(plume) and plume.off == nearest for plume in self.plumes]

    @property
    def found(self) -> StatedPlume | None:
        """The plume that is there, where it was found."""
        true = [each for each, right in zip(self.plumes, self.truths, strict=True) if right]
        return true[0] if true else None

    @property
    def surest(self) -> Candidate | None:
        return max(self.candidates, key=lambda each: each.probability, default=None)

    @property
    def over_limit(self) -> float:
        """Strength in units of the stated limit; NaN where none was stated."""
        return np.nan if self.limit_px is None else self.strength_px / self.limit_px

    @classmethod
    def load(cls, path: Path) -> "RecordingOutcome":
        content = json.loads(path.read_text())
        candidates = tuple(Candidate(**each) for each in content.pop("candidates"))
        plumes = tuple(StatedPlume(**each) for each in content.pop("plumes"))
        return cls(**content, candidates=candidates, plumes=plumes)

    def save(self, path: Path) -> None:
        with atomic_path(path) as unfinished:
            unfinished.write_text(json.dumps(asdict(self)))
