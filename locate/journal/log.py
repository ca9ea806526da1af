"""What a run says while it works: log.jsonl for programs, progress bars for people."""

import json
import logging
import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TypeAlias

from rich.console import Console
from rich.logging import RichHandler
from rich.progress import (
    BarColumn,
    Progress,
    TaskID,
    TaskProgressColumn,
    TextColumn,
    TimeRemainingColumn,
)

from geometry.errors import InterruptedRunError, LocateError

Report: TypeAlias = Callable[[str, float], None]
FIELDS = ("stage", "wall_s", "cpu_s")


def silent(stage: str, share: float) -> None:
    """A progress report that nobody reads."""


class JsonLines(logging.Formatter):
    """One JSON object a line."""

    def format(self, record: logging.LogRecord) -> str:
        """Renders time, level, message and the stage's figures."""
        line = {
            "time_s": round(record.created, 3),
            "level": record.levelname.lower(),
            "message": record.getMessage(),
        }
        line |= {name: getattr(record, name) for name in FIELDS if hasattr(record, name)}
        return json.dumps(line)


@contextmanager
def journal(path: Path, *, console: Console | None = None) -> Iterator[None]:
    """Appends what happens inside to log.jsonl, and to the console where one is given."""
    log = logging.getLogger("locate")
    file = logging.FileHandler(path)
    file.setFormatter(JsonLines())
    handlers: list[logging.Handler] = [file]
    if console is not None:
        handlers.append(RichHandler(console=console, show_path=False))
    before = log.level
    log.setLevel(logging.INFO)
    for handler in handlers:
        log.addHandler(handler)
    try:
        yield
    except LocateError as error:
        log.error(str(error))
        raise
    finally:
        log.setLevel(before)
        for handler in handlers:
            log.removeHandler(handler)
            handler.close()


@contextmanager
def interruptible() -> Iterator[None]:
    """Turns Ctrl-C and SIGTERM into one line that says how to go on.

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
