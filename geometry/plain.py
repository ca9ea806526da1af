"""Arrays and tuples as the plain values that JSON knows."""

import math
from typing import Any

import numpy as np


def to_plain_values(value: Any, *, null_for_nan: bool = False) -> Any:
    """Lists, dicts and Python scalars in place of arrays, tuples and numpy scalars, at any depth.

    Args:
        value: Anything made of these.
        null_for_nan: Turn numbers that are not finite into None.
    """
    if isinstance(value, dict):
        return {
            name: to_plain_values(item, null_for_nan=null_for_nan) for name, item in value.items()
        }
    if isinstance(value, np.ndarray | np.generic):
        return to_plain_values(value.tolist(), null_for_nan=null_for_nan)
    if isinstance(value, list | tuple):
        return [to_plain_values(item, null_for_nan=null_for_nan) for item in value]
    missing = null_for_nan and isinstance(value, float) and not math.isfinite(value)
    return None if missing else value
