"""Large tables of which a part is used."""

import math
import mmap
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import DTypeLike, NDArray


def map_array(shape: Sequence[int], dtype: DTypeLike) -> NDArray[Any]:
    """An array of zeros of its own pages: each takes memory from when it is first written to.

    They go back to the system with the array. For large tables of which a part is used.

    Args:
        shape: Of the array, with at least one element.
        dtype: Likewise.
    """
    kind = np.dtype(dtype)
    pages = mmap.mmap(
        -1, math.prod(shape) * kind.itemsize, flags=mmap.MAP_PRIVATE | mmap.MAP_ANONYMOUS
    )
    return np.frombuffer(pages, kind).reshape(shape)
