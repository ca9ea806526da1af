"""JSON that was read from a file that may be hostile."""

import json
from typing import Any

LARGEST_INT = 2**63 - 1
"""What arrays of whole numbers hold; larger ones overflow where they are computed with."""


def parse_json(text: str | bytes) -> Any:
    """What a JSON text says.

    Raises:
        ValueError: It is not JSON, nested so deeply that no file of ours is, or holds a whole
            number that no array does.
    """
    try:
        return json.loads(text, parse_int=_bounded_int)
    except RecursionError:
        raise ValueError("nested too deeply") from None


def _bounded_int(text: str) -> int:
    if len(text) > len(str(-LARGEST_INT)) or abs(int(text)) > LARGEST_INT:
        raise ValueError(f"a whole number of {len(text)} digits")
    return int(text)
