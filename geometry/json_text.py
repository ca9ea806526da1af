"""JSON text from a file that may be hostile."""

import json
from typing import Any

LARGEST_INT = 2**63 - 1
"""What arrays of whole numbers hold; larger ones overflow where they are computed with."""


def parse_json(text: str | bytes) -> Any:
    """The content of a JSON text.

    Raises:
        ValueError: It is not JSON, nested so deeply that no file of ours is, gives a name twice, or
            holds a whole number that no array does.
    """
    try:
        return json.loads(text, parse_int=_bounded_int, object_pairs_hook=_once_each)
    except json.JSONDecodeError as error:
        raise ValueError(f"not JSON ({error})") from error
    except RecursionError:
        raise ValueError("nested too deeply") from None


def given_twice(name: str) -> ValueError:
    """A name that a text gives twice, of which one reader takes the first and another the last."""
    return ValueError(f"{name[:40]!r} is given twice; keep one")


def _bounded_int(text: str) -> int:
    if len(text) > len(str(-LARGEST_INT)) or abs(int(text)) > LARGEST_INT:
        raise ValueError(f"a whole number of {len(text)} digits")
    return int(text)


def _once_each(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    found: dict[str, Any] = {}
    for name, value in pairs:
        if name in found:
            raise given_twice(name)
        found[name] = value
    return found
