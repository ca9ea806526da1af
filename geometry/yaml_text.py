"""YAML that was read from a file that may be hostile."""

from typing import Any

import yaml

MOST_VALUES = 1_000_000
"""A text says no more, counted as if each alias were written out; ours say some hundred."""


def parse_yaml(text: str | bytes) -> Any:
    """What a YAML text says.

    Raises:
        yaml.YAMLError: It is not YAML, or its nesting or aliases unfold without end.
    """
    try:
        content = yaml.safe_load(text)
        if _count_values(content, {}) <= MOST_VALUES:
            return content
    except RecursionError:
        raise yaml.YAMLError("nested too deeply") from None
    except ValueError as error:
        raise yaml.YAMLError(" ".join(str(error).split())) from error
    raise yaml.YAMLError("its aliases unfold to too many values")


def _count_values(value: Any, known: dict[int, int]) -> int:
    """How many values there are, each as often as it is named; one in itself is RecursionError."""
    if not isinstance(value, dict | list | set | tuple):
        return 1
    if id(value) not in known:
        inner = [*value, *value.values()] if isinstance(value, dict) else value
        known[id(value)] = 1 + sum(_count_values(item, known) for item in inner)
    return known[id(value)]
