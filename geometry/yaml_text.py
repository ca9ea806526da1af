"""YAML text from a file that may be hostile."""

from collections import Counter
from typing import Any

import yaml

from geometry.json_text import LARGEST_INT, given_twice

LONGEST = 2**18
"""Characters of a text at most, which take some 6 CPU s; usual ones have some thousand."""
MOST_VALUES = 1_000_000
"""Values of a text at most, each alias counted as if it were written out; usual ones have some
hundred."""
MERGE = "tag:yaml.org,2002:merge"


def parse_yaml(text: str) -> Any:
    """The content of a YAML text.

    Raises:
        ValueError: It is not YAML or very long, its nesting or aliases unfold without end, it
            merges mappings (`<<`), gives a key twice, or holds a number in base 60 or one that no
            array holds.
    """
    if len(text) > LONGEST:
        raise ValueError(f"{len(text)} characters, at most {LONGEST} are read")
    try:
        content = yaml.load(text, PlainLoader)
        if _count_values(content, {}) <= MOST_VALUES:
            return content
    except RecursionError:
        raise ValueError("nested too deeply") from None
    except yaml.YAMLError as error:
        raise ValueError(f"not YAML ({' '.join(str(error).split())})") from error
    except OverflowError as error:
        raise ValueError(str(error)) from error
    raise ValueError("its aliases unfold to too many values")


class PlainLoader(yaml.SafeLoader):
    """A SafeLoader without what is ambiguous, or takes a time that grows faster than the text."""

    def flatten_mapping(self, node: yaml.MappingNode) -> None:
        """Merges of merges double the mapping with every line; a key is given once."""
        if any(key.tag == MERGE for key, _ in node.value):
            raise ValueError("merges of mappings (<<) are not read; write the values out")
        keys = (key for key, _ in node.value if isinstance(key, yaml.ScalarNode))
        for (_, name), count in Counter((key.tag, key.value) for key in keys).items():
            if count > 1:
                raise given_twice(name)

    def construct_yaml_int(self, node: yaml.ScalarNode) -> int:
        """A whole number; in base 60 its digits take the square of their number in time."""
        text = self.construct_scalar(node)
        _refuse_base_60(text)
        number = int(super().construct_yaml_int(node))
        if abs(number) > LARGEST_INT:
            raise ValueError(f"a whole number of {len(text)} digits")
        return number

    def construct_yaml_float(self, node: yaml.ScalarNode) -> float:
        """A number, not in base 60."""
        _refuse_base_60(self.construct_scalar(node))
        return float(super().construct_yaml_float(node))


PlainLoader.add_constructor("tag:yaml.org,2002:int", PlainLoader.construct_yaml_int)
PlainLoader.add_constructor("tag:yaml.org,2002:float", PlainLoader.construct_yaml_float)


def _refuse_base_60(text: str) -> None:
    if ":" in text:
        raise ValueError(f'{text[:20]} would be a number in base 60; write "{text[:20]}"')


def _count_values(value: Any, known: dict[int, int]) -> int:
    """How many values there are, each as often as it is named; one in itself is RecursionError."""
    if not isinstance(value, dict | list | set | tuple):
        return 1
    if id(value) not in known:
        inner = [*value, *value.values()] if isinstance(value, dict) else value
        known[id(value)] = 1 + sum(_count_values(item, known) for item in inner)
    return known[id(value)]
