"""What memory a process holds."""

import platform
import resource
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from geometry.mapped_array import map_array

PAGES = """
import resource
from geometry.memory import keep_freed_memory

def count_faults():
    before = resource.getrusage(resource.RUSAGE_SELF).ru_minflt
    arrays = [b"x" * 8_000_000 for _ in range(4)]
    del arrays
    return resource.getrusage(resource.RUSAGE_SELF).ru_minflt - before

freed = [count_faults() for _ in range(3)][-1]
keep_freed_memory()
kept = [count_faults() for _ in range(3)][-1]
print(freed, kept)
"""


@pytest.mark.skipif(platform.libc_ver()[0] != "glibc", reason="a setting of glibc")
def test_memory_that_is_taken_again_costs_no_new_pages() -> None:
    done = subprocess.run([sys.executable, "-c", PAGES], capture_output=True, check=True)
    freed, kept = map(int, done.stdout.split())
    assert kept < freed / 100


def held_bytes() -> int:
    return int(Path("/proc/self/statm").read_text().split()[1]) * resource.getpagesize()


@pytest.mark.skipif(sys.platform != "linux", reason="/proc")
def test_a_mapped_array_holds_the_pages_that_are_written() -> None:
    before = held_bytes()
    table = map_array((1 << 28, 2), np.float16)
    assert table.shape == (1 << 28, 2)
    assert held_bytes() - before < 1 << 24
    table[: 1 << 24] = 1
    assert 1 << 26 <= held_bytes() - before < 1 << 27
    assert table[1 << 24 :: 1 << 22].max() == 0
    del table
    assert held_bytes() - before < 1 << 24
