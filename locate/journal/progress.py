"""How far a command is, and what ends it early."""

import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TypeAlias

from rich.console import Console
from rich.progress import (
    BarColumn,
    Progress,
    TaskID,
    TaskProgressColumn,
    TextColumn,
    TimeRemainingColumn,
)

from geometry.errors import InterruptedRunError

Report: TypeAlias = Callable[[str, float], None]
"""Takes the name of a stage and the share of it that is done; below 0 it has no known end."""


def silent(stage: str, share: float) -> None:
    """A progress report that nobody reads."""


@contextmanager
def interruptible() -> Iterator[None]:
    """Turns Ctrl-C and SIGTERM into one line that states how to continue.

    Enter it after pycolmap was imported, which answers SIGTERM with a stack trace of its own.
    """
    before = signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        yield
    except KeyboardInterrupt:
        raise InterruptedRunError("interrupted; the same command goes on from here") from None
    finally:
        signal.signal(signal.SIGTERM, before or signal.SIG_DFL)


@contextmanager
def progress_bars(console: Console) -> Iterator[Report]:
    """A bar with the time left for every stage that reports; shares below 0 have no known end."""
    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        TaskProgressColumn(),
        TimeRemainingColumn(elapsed_when_finished=True),
    )
    with Progress(*columns, console=console) as bars:
        tasks: dict[str, TaskID] = {}

        def report(stage: str, share: float) -> None:
            if stage not in tasks:
                tasks[stage] = bars.add_task(stage, total=None)
            if share >= 0:
                bars.update(tasks[stage], total=1.0, completed=share)

        yield report
