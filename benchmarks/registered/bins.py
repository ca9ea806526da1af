"""What a stated log-likelihood ratio is worth, by what is stated."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from benchmarks.registered.tally import ClipTally
from detect.evidence import LLR_MAX, LLR_MIN
from detect.registered.evidence_network import CLASS_NAMES

BINS = np.array([LLR_MIN, -1, -0.5, 0.5, 1, 1.5, 2, 2.5, 3, 3.5, LLR_MAX])
FEWEST = 50
DRAWN = 200
NEAR = 0.3


@dataclass(frozen=True, kw_only=True)
class EvidenceBin:
    """Nats; `scatter` is a standard deviation of `observed`."""

    observed: float
    scatter: float
    stated: float

    def __str__(self) -> str:
        return f"{self.observed:.1f} ± {self.scatter:.1f} at {self.stated:.1f}"

    @property
    def gap(self) -> float:
        return abs(self.observed - self.stated)


def measure_reliability(
    llr: np.ndarray, positive: np.ndarray, recording: np.ndarray
) -> list[EvidenceBin | None]:
    """Of each of `BINS`; the bounds are bins of their own."""
    edges = [*(BINS[:-1] + 1e-3), LLR_MAX - 1e-3]
    unmeasured = len(edges) + 1
    if min(positive.sum(), (~positive).sum()) < FEWEST:
        return [None] * unmeasured
    which = np.where(llr == 0, unmeasured, np.digitize(llr, edges, right=True))
    ids, row = np.unique(recording, return_inverse=True)
    counts = np.zeros((2, len(ids), unmeasured + 1))
    np.add.at(counts, (positive.astype(int), row, which), 1)
    again = np.random.default_rng(0).multinomial(len(ids), np.ones(len(ids)) / len(ids), DRAWN)
    observed, scatter = observed_nats(counts.sum(axis=1)), observed_nats(again @ counts).std(axis=0)
    fewest = counts.sum(axis=1).min(axis=0)
    return [
        EvidenceBin(observed=observed[k], scatter=scatter[k], stated=llr[which == k].mean())
        if fewest[k] >= FEWEST
        else None
        for k in range(unmeasured)
    ]


def observed_nats(counts: np.ndarray) -> np.ndarray:
    """(..., B) nats, of (2, ..., B) pixels of either kind; half a pixel more, so none is empty."""
    misses, hits = np.log((counts + 0.5) / counts.sum(axis=-1, keepdims=True))
    return np.asarray(hits - misses)


def bin_cells(bins: Sequence[EvidenceBin | None]) -> str:
    return " | ".join(str(one or "") for one in bins)


def print_reliability(tallies: dict[str, ClipTally]) -> None:
    columns = {
        name: np.concatenate([tally[name] for tally in tallies.values()])
        for name in ("learned", "positive", "place", "recording")
    }
    print("\n| reliability | " + " | ".join(f"to {high:g}" for high in [*BINS, np.inf]) + " |")
    print("|" + "---|" * (len(BINS) + 2))
    rows = {"all": columns["positive"] | True}
    rows |= {name: columns["place"] == k for k, name in enumerate(CLASS_NAMES)}
    judged: list[EvidenceBin] = []
    for name, members in rows.items():
        bins = measure_reliability(
            *(columns[n][members] for n in ("learned", "positive", "recording"))
        )
        print(f"| {name}, {members.mean():.2f} of pixels | {bin_cells(bins)} |")
        judged += [one for one in bins if one and name != "all"]
    for name, tally in tallies.items():
        if tally["positive"].any():
            bins = measure_reliability(tally["learned"], tally["positive"], tally["recording"])
            print(f"| {name} | {bin_cells(bins)} |")
    for low, high in ((LLR_MIN, 0.5), (0.5, LLR_MAX)):
        some = [one for one in judged if low + 1e-3 < one.stated < high - 1e-3]
        near = sum(one.gap <= NEAR for one in some)
        likely = sum(one.gap <= max(NEAR, 2 * one.scatter) for one in some)
        print(f"{low:g} to {high:g} nats: of {len(some)} bins of classes {near} within {NEAR}, "
              f"{likely} within that or twice the scatter")  # fmt: skip
    for name, tally in tallies.items():
        print(f"NEES of the displacement, {name}: {tally.nees()}")
