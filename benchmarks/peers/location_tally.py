"""What one way of locating made of many cases."""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from benchmarks.common.cost import cpu_seconds
from benchmarks.common.csv_tables import Row
from benchmarks.peers.blobs import SourceEstimate
from geometry.arrays import FloatArray
from locate.fusion.views import Views

FOUND_SHARE = 0.15


@dataclass(frozen=True, kw_only=True)
class Case:
    """Views, and the source that they show; None where there is none."""

    views: Views
    source: FloatArray | None
    range_m: float


@dataclass(kw_only=True)
class Tally:
    """Of each case in turn.

    Attributes:
        percents: Errors in % of the range, of those found.
        nees: Squared errors in units of their covariance, over 3, likewise.
        plumes: Cases with a plume.
        empty: Cases without one.
        false: Sources stated where none is near.
        spent: CPU seconds of each case.
    """

    percents: list[float] = field(default_factory=list)
    nees: list[float] = field(default_factory=list)
    plumes: int = 0
    empty: int = 0
    false: int = 0
    spent: list[float] = field(default_factory=list)

    def add(self, case: Case, locate: Callable[[], SourceEstimate | None]) -> None:
        """Locates, and judges the answer."""
        answers: list[SourceEstimate | None] = []
        self.spent.append(cpu_seconds(lambda: answers.append(locate())).item())
        (answer,) = answers
        self.plumes += case.source is not None
        self.empty += case.source is None
        if answer is None:
            return
        error = None if case.source is None else answer.source - case.source
        if error is None or np.linalg.norm(error) > FOUND_SHARE * case.range_m:
            self.false += 1
            return
        self.percents.append(100 * float(np.linalg.norm(error)) / case.range_m)
        self.nees.append(float(error @ np.linalg.solve(answer.covariance, error)) / 3)

    def row(self, name: str, ours: "Tally") -> Row:
        """Of the table."""
        of_ours = np.median(np.array(self.spent) / np.array(ours.spent))
        return {
            "way": name,
            "found": f"{len(self.percents)} of {self.plumes}",
            "false": f"{self.false} in {self.plumes + self.empty}",
            "error, % of range, median": f"{quantile(self.percents, 0.5):.2f}",
            "90 % below": f"{quantile(self.percents, 0.9):.2f}",
            "NEES/dof, mean": f"{np.mean(self.nees) if self.nees else np.nan:.3g}",
            "NEES/dof, median": f"{quantile(self.nees, 0.5):.3g}",
            "CPU s": f"{np.median(self.spent):.2f}",
            "CPU, of ours": f"{of_ours:.3f}",
        }


def quantile(values: list[float], share: float) -> float:
    return float(np.quantile(values, share)) if values else float("nan")
