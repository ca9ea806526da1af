"""What reading one file may cost: no reader runs for ever or takes all memory."""

import faulthandler
import resource
import signal
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from time import process_time

from geometry.errors import LocateError

MOST_CPU_S = 10.0
MOST_BYTES = 2 * 2**30
HANG_S = 3600.0
"""After so long the process is ended, with a traceback: a hang within a library answers nothing."""
LONGEST_REFUSAL = 1000
"""Characters."""


def read_bounded(read: Callable[[Path], object], path: Path) -> None:
    """Reads a file, whose only outcomes are a result or one clear line.

    Raises:
        AssertionError: The line is none, or it took too long or too much memory.
    """
    started_s, before = process_time(), _restart_peak()
    with hang_guarded():
        try:
            read(path)
        except LocateError as error:
            refusal = str(error)
            assert refusal.strip()
            assert len(refusal.splitlines()) == 1
            assert len(refusal) - refusal.count(str(path)) * len(str(path)) < LONGEST_REFUSAL
    assert process_time() - started_s < MOST_CPU_S
    assert _status_bytes("VmHWM") - before < MOST_BYTES


@contextmanager
def hang_guarded() -> Iterator[None]:
    """Ends the process where the block does not end."""
    faulthandler.dump_traceback_later(HANG_S, exit=True, file=sys.__stderr__)
    try:
        yield
    finally:
        faulthandler.cancel_dump_traceback_later()


@contextmanager
def impatient() -> Iterator[None]:
    """Raises where the block waits for somebody else."""

    def raise_timeout(*_: object) -> None:
        raise AssertionError("it waits")

    before = signal.signal(signal.SIGALRM, raise_timeout)
    signal.setitimer(signal.ITIMER_REAL, MOST_CPU_S)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, before)


@contextmanager
def memory_limited() -> Iterator[None]:
    """Limits what all examples of a test together may keep, so that the machine stays usable."""
    soft, hard = resource.getrlimit(resource.RLIMIT_AS)
    resource.setrlimit(resource.RLIMIT_AS, (_status_bytes("VmSize") + 2 * MOST_BYTES, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_AS, (soft, hard))


def _restart_peak() -> int:
    """Forgets the highest memory of this process so far; returns what it uses now."""
    Path("/proc/self/clear_refs").write_text("5")
    return _status_bytes("VmRSS")


def _status_bytes(name: str) -> int:
    for line in Path("/proc/self/status").read_text().splitlines():
        if line.startswith(name + ":"):
            return int(line.split()[1]) * 1024
    raise KeyError(name)
