"""Several ways to the same end, timed in turn."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from benchmarks.common.cost import cpu_seconds

ROUNDS = 5


@dataclass(frozen=True, kw_only=True)
class TurnCost:
    """What one way costs.

    Attributes:
        cpu_s: Median over the rounds.
        of_first: Median of its CPU seconds over those of the first way in the same round.
    """

    cpu_s: float
    of_first: float


def time_in_turn(ways: Mapping[str, Callable[[], object]]) -> dict[str, TurnCost]:
    """Runs all of them once, then one after the other in every round, as a busy machine drifts."""
    for way in ways.values():
        way()
    spent = np.array([[cpu_seconds(way).item() for way in ways.values()] for _ in range(ROUNDS)])
    return costs_of(dict(zip(ways, spent.T, strict=True)))


def costs_of(spent: Mapping[str, np.ndarray]) -> dict[str, TurnCost]:
    """From the CPU seconds of each way in each round."""
    first = next(iter(spent.values()))
    return {
        name: TurnCost(cpu_s=float(np.median(one)), of_first=float(np.median(one / first)))
        for name, one in spent.items()
    }
