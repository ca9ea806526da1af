"""The entry of the command line, and how a failure ends."""

import os
import signal
import sqlite3
import sys
from io import TextIOWrapper
from typing import TYPE_CHECKING, Any

from geometry.errors import INTERRUPTED, KEPT, InterruptedRunError, LocateError, describe_error
from geometry.memory import keep_freed_memory

if TYPE_CHECKING:
    from locate.commands.app import app

__all__ = ["app", "main"]


def main() -> None:
    """Runs the command; every expected failure becomes one line and an exit code."""
    _leave_at_once_when_interrupted()
    keep_freed_memory()
    os.environ.setdefault("OPENCV_LOG_LEVEL", "SILENT")  # what it refuses is said in one line
    from locate.commands.app import app

    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, TextIOWrapper):  # names that are not UTF-8 are printed escaped
            stream.reconfigure(errors="backslashreplace")
    try:
        app()
    except LocateError as error:
        _fail(str(error), error.exit_code)
    except (OSError, MemoryError, sqlite3.OperationalError) as error:
        _fail(f"{describe_error(error)}; {KEPT}", 2)


def __getattr__(name: str) -> Any:
    if name != "app":
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from locate.commands.app import app

    return app


def _leave_at_once_when_interrupted() -> None:
    """Until a command begins, which has nothing to leave in order; modules are still loading."""

    def leave(*_: object) -> None:
        os.write(sys.stderr.fileno(), f"locate: {INTERRUPTED}\n".encode())
        os._exit(InterruptedRunError.exit_code)

    if signal.getsignal(signal.SIGINT) is not signal.SIG_IGN:
        signal.signal(signal.SIGINT, leave)
    signal.signal(signal.SIGTERM, leave)


def _fail(message: str, code: int) -> None:
    from locate.commands.console import err

    err.print(f"locate: {message}", style="bold red", soft_wrap=True, highlight=False)
    sys.exit(code)
