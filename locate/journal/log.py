"""log.jsonl: what a command did, a line for each event, for programs."""

import json
import logging
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from rich.console import Console
from rich.logging import RichHandler

from geometry.errors import LocateError
from geometry.printable import printable
from geometry.regular_files import append_regular

FIELDS = ("stage", "wall_s", "cpu_s")


class JsonLines(logging.Formatter):
    """One JSON object a line."""

    def format(self, record: logging.LogRecord) -> str:
        """Renders time, level, message and the stage's figures."""
        line = {
            "time_s": round(record.created, 3),
            "level": record.levelname.lower(),
            "message": printable(record.getMessage()),
        }
        line |= {name: getattr(record, name) for name in FIELDS if hasattr(record, name)}
        return json.dumps(line)


class StageLines(logging.Formatter):
    """A line for people: the stage, what happened in it, and how long it took."""

    def format(self, record: logging.LogRecord) -> str:
        """Renders stage, message and wall time, as far as they are there."""
        stage, wall_s = getattr(record, "stage", None), getattr(record, "wall_s", None)
        took = "" if wall_s is None else f" ({wall_s:.1f} s)"
        return f"{'' if stage is None else stage + ': '}{printable(record.getMessage())}{took}"


class AppendedLines(logging.Handler):
    """Appends each line at once; several processes may, and a full disk costs the line only."""

    def __init__(self, path: Path) -> None:
        super().__init__()
        self.path = path
        self.setFormatter(JsonLines())

    def emit(self, record: logging.LogRecord) -> None:
        """Writes one event."""
        with suppress(OSError), append_regular(self.path) as file:
            file.write(self.format(record) + "\n")


@contextmanager
def log_to_file(
    path: Path, *, console: Console | None = None, shown: int = logging.INFO
) -> Iterator[None]:
    """Appends what happens inside to log.jsonl, and to the console where one is given.

    Args:
        path: The file.
        console: Shows it to people too; errors end a command, which prints them itself.
        shown: The least level that the console shows.
    """
    log = logging.getLogger("locate")
    handlers: list[logging.Handler] = [AppendedLines(path)]
    if console is not None:
        people = RichHandler(level=shown, console=console, show_path=False)
        people.setFormatter(StageLines())
        people.addFilter(lambda record: record.levelno < logging.ERROR)
        handlers.append(people)
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
