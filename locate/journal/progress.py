"""How far a command is, and what ends it early."""

import signal
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from importlib import import_module

from rich.console import Console
from rich.progress import (
    BarColumn,
    Progress,
    SpinnerColumn,
    TaskID,
    TaskProgressColumn,
    TextColumn,
    TimeRemainingColumn,
)

from geometry.errors import INTERRUPTED, InterruptedRunError
from geometry.reports import Report, ignore_report

SIGNALS = (signal.SIGINT, signal.SIGTERM)


@contextmanager
def interruptible() -> Iterator[None]:
    """Turns Ctrl-C and SIGTERM into one line that states how to continue.

    pycolmap answers SIGTERM with a stack trace of its own from its import on, so that comes first,
    and signals wait for it. What a library makes of an interrupt, another error, is no matter.

    Raises:
        InterruptedRunError: In place of whatever ended the block after one of the signals.
    """
    interrupted, loading = False, True

    def interrupt(*_: object) -> None:
        nonlocal interrupted
        interrupted = True
        if not loading:
            raise KeyboardInterrupt

    before = {number: signal.getsignal(number) for number in SIGNALS}
    heeded = [number for number in SIGNALS if before[number] is not signal.SIG_IGN]
    try:
        _answer_with(interrupt, heeded)
        import_module("pycolmap")
        _answer_with(interrupt, heeded)
        loading = False
        if interrupted:
            raise KeyboardInterrupt
        yield
    except BaseException as error:
        if interrupted or isinstance(error, KeyboardInterrupt):
            raise InterruptedRunError(INTERRUPTED) from None
        raise
    finally:
        for number, handler in before.items():
            signal.signal(number, handler or signal.SIG_DFL)


def _answer_with(handler: Callable[..., None], numbers: Sequence[signal.Signals]) -> None:
    for number in numbers:
        signal.signal(number, handler)


@contextmanager
def progress_bars(console: Console) -> Iterator[Report]:
    """A bar with the time left for every stage that reports, where someone looks at the console.

    Shares below 0 have no known end.
    """
    if not console.is_terminal:
        yield ignore_report
        return
    columns = (
        TextColumn("{task.description}", markup=False),
        SpinnerColumn(),
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
