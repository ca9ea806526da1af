"""How far a whole run is, and how long it still takes, also between two reports of a stage."""

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass

from rich.console import Console
from rich.progress import Progress, ProgressColumn, SpinnerColumn, Task, TextColumn
from rich.progress_bar import ProgressBar
from rich.text import Text

from geometry.reports import Report, ignore_report

USUAL_S = {"frames": 2.0, "poses": 8.0, "detections": 15.0, "fusion": 15.0, "report": 2.5}
"""Of each stage, what the bundled sample takes where nothing else runs, about, s."""
READING = "frames"
"""Takes as long as the recording is; the others do not depend on that."""
PRIOR_S = 2.0
"""Seconds at the usual pace that are added to those measured, so that few of these decide less."""
LEAST_SHARE = 0.02
"""Share of a stage from which on its own pace counts."""
LEAST_LEFT = 0.02
"""Share of a stage that is left at least until it ends."""


@dataclass
class _Stage:
    """A stage at work: when it began and last reported, and the share that it had done then."""

    begun_s: float
    reported_s: float
    share: float = 0.0


class RunProgress:
    """The stages of one run on a clock.

    A stage that reports for the first time ends the one before it; those that never reported were
    skipped. What is left of a stage follows from its own pace, later ones take what they usually
    do, times the pace of those before.

    Args:
        clock: Seconds that never fall.
    """

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._begun_s = clock()
        self._stages: dict[str, _Stage] = {}
        self._shown = 0.0

    @property
    def stage(self) -> str:
        """Of the last report; ``starting`` before the first."""
        return next(reversed(self._stages), "starting")

    @property
    def number(self) -> int:
        """Which of the stages that is, from 1; 0 before the first."""
        return list(USUAL_S).index(self.stage) + 1 if self._stages else 0

    def report(self, stage: str, share: float) -> None:
        """Takes the progress of a stage, see `Report`; others than the usual take no time."""
        if stage not in USUAL_S:
            return
        now_s = self._clock()
        if stage not in self._stages:
            if self._stages:
                before = self._stages[self.stage]
                before.reported_s, before.share = now_s, 1.0
            self._stages[stage] = _Stage(now_s, now_s)
        at_work = self._stages[stage]
        at_work.reported_s, at_work.share = now_s, max(at_work.share, share)

    def share(self) -> float:
        """The share of the run's time that has passed, from 0 to 1; it never falls."""
        passed_s = self._clock() - self._begun_s
        self._shown = max(self._shown, passed_s / max(passed_s + self.left_s(), 1e-9))
        return self._shown

    def left_s(self) -> float:
        """Seconds that the rest of the run takes, about."""
        later_s = self._pace() * sum(list(USUAL_S.values())[self.number :])
        return later_s + (self._stage_left_s() if self._stages else 0.0)

    def _stage_left_s(self) -> float:
        stage = self._stages[self.stage]
        if stage.share >= 1:
            return 0.0
        whole_s = USUAL_S[self.stage] * self._pace()
        if stage.share > LEAST_SHARE:
            whole_s = (stage.reported_s - stage.begun_s) / stage.share
        return max(whole_s - (self._clock() - stage.begun_s), LEAST_LEFT * whole_s)

    def _pace(self) -> float:
        """Seconds that pass for each usual one."""
        measured = [(name, one) for name, one in self._stages.items() if name != READING]
        passed_s = sum(one.reported_s - one.begun_s for _, one in measured)
        usual_s = sum(USUAL_S[name] * one.share for name, one in measured)
        return (PRIOR_S + passed_s) / (PRIOR_S + usual_s)


class _WholeBar(ProgressColumn):
    def __init__(self, run: RunProgress) -> None:
        super().__init__()
        self._run = run

    def render(self, task: Task) -> ProgressBar:  # noqa: ARG002 - rich gives it
        """The bar, as far as the run is now."""
        return ProgressBar(total=1.0, completed=self._run.share(), width=40)


class _TimeLeft(ProgressColumn):
    def __init__(self, run: RunProgress) -> None:
        super().__init__()
        self._run = run

    def render(self, task: Task) -> Text:  # noqa: ARG002 - rich gives it
        """The stage and the time that is left of the whole run."""
        minutes, seconds = divmod(round(self._run.left_s()), 60)
        left = f"{self._run.share():4.0%}, about {minutes}:{seconds:02d} left of the run"
        where = f"{self._run.stage} ({self._run.number} of {len(USUAL_S)})"
        return Text(f"{left}; {where if self._run.number else self._run.stage}")


@contextmanager
def run_bar(console: Console) -> Iterator[Report]:
    """One bar for all stages of a run, where someone looks at the console; else nothing."""
    if not console.is_terminal:
        yield ignore_report
        return
    run = RunProgress()
    columns = (SpinnerColumn(), TextColumn("{task.description}"), _WholeBar(run), _TimeLeft(run))
    with Progress(*columns, console=console, transient=True) as bars:
        bars.add_task("run", total=None)
        yield run.report
