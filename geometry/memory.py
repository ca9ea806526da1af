"""Memory that is freed stays with the process, for what it takes next.

Arrays of some megabytes come and go by the thousand. Handed back to the system each time, their
pages are zeroed and mapped anew, which takes up to half of the time of what is computed in them.
"""

import ctypes
import sys

KEPT_BYTES = 1 << 26
"""Most of it that is kept; chosen by hand."""
MAPPED_BYTES = 1 << 25
"""Larger arrays are handed back all the same; chosen by hand."""
TRIM_THRESHOLD, MMAP_THRESHOLD = -1, -3
"""As glibc's mallopt counts its settings."""


def keep_freed_memory() -> None:
    """Asks glibc to keep what this process frees; without glibc nothing changes."""
    mallopt = getattr(ctypes.CDLL(None), "mallopt", None) if sys.platform == "linux" else None
    if mallopt is not None:
        mallopt(TRIM_THRESHOLD, KEPT_BYTES)
        mallopt(MMAP_THRESHOLD, MAPPED_BYTES)
