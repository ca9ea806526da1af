"""Memory that is freed stays with the process."""

import platform
import subprocess
import sys

import pytest

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
