"""What Python does to the files of a folder, counted, and something done at one of them."""

import os
import signal
import sys
from collections.abc import Callable
from itertools import count
from pathlib import Path
from typing import Any
from unittest.mock import patch

from locate.pipeline import poses

CHANGES = ("open", "os.mkdir", "os.remove", "os.rename", "os.rmdir", "os.truncate")
"""Names of Python's audit events."""


def at_change(folder: Path, number: int, act: Callable[[], object]) -> Callable[[], None]:
    """Sets `act` to be done just before a change of the folder, and before each one after it.

    Structure from motion then has no process of its own, so that its changes count too.

    Args:
        folder: With all below it.
        number: Of the change, from 0.
        act: What it raises is raised in place of the change.
    """
    counted = count()

    def watch(event: str, given: tuple[Any, ...]) -> None:
        if event in CHANGES and _is_change(event, given, folder) and next(counted) >= number:
            act()

    def begin() -> None:
        patch.object(poses, "call_apart", _call_here).start()
        sys.addaudithook(watch)

    return begin


def _call_here(
    function: Callable[..., Any],
    *arguments: Any,
    name: str,  # noqa: ARG001 - as of `call_apart`
    report: Callable[[str, float], object],
    ahead: object,  # noqa: ARG001 - likewise
    **keywords: Any,
) -> Any:
    return function(*arguments, progress=report, **keywords)


def _is_change(event: str, given: tuple[Any, ...], folder: Path) -> bool:
    if event == "open":
        path, _, flags = given
        writes = flags & (os.O_WRONLY | os.O_RDWR | os.O_CREAT)
        return bool(writes) and _is_below(path, folder)
    opened_folder = isinstance(given[-1], int) and given[-1] >= 0 and event != "os.mkdir"
    return opened_folder or any(_is_below(path, folder) for path in given[:2])


def _is_below(path: Any, folder: Path) -> bool:
    return isinstance(path, str | Path) and str(path).startswith(f"{folder}/")


def kill() -> None:
    """Ends this process as a loss of power would: nothing cleans up."""
    os.kill(os.getpid(), signal.SIGKILL)


def fail(number: int) -> Callable[[], None]:
    """What raises this error of the system."""

    def raise_error() -> None:
        raise OSError(number, os.strerror(number))

    return raise_error
