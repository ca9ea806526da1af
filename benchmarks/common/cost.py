"""CPU time and memory of what is measured."""

import resource
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

from geometry.arrays import FloatArray


def cpu_seconds(work: Callable[[], object], times: int = 1) -> FloatArray:
    """(times,) CPU s of this process for each call."""
    spent = []
    for _ in range(times):
        start = time.process_time()
        work()
        spent.append(time.process_time() - start)
    return np.array(spent)


def peak_mib() -> float:
    """The most memory that this process has held so far, MiB.

    By Linux's own count: that of `getrusage` begins with what the parent held when it started this
    process.
    """
    status = Path("/proc/self/status")
    if not status.exists():
        return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    (line,) = (line for line in status.read_text().splitlines() if line.startswith("VmHWM:"))
    return int(line.split()[1]) / 1024


def children_cpu_s() -> float:
    """CPU s of the processes that this one started and that have ended."""
    usage = resource.getrusage(resource.RUSAGE_CHILDREN)
    return usage.ru_utime + usage.ru_stime


def children_peak_mib() -> float:
    """The most memory that one of them has held, MiB."""
    return resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss / 1024


def folder_mib(folder: Path) -> float:
    """What the files in a folder take of the disk, MiB."""
    return sum(path.stat().st_size for path in folder.rglob("*") if path.is_file()) / 2**20
