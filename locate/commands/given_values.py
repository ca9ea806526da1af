"""The values that a command is given, before it uses any of them."""

import math
from collections.abc import Callable
from functools import wraps
from pathlib import Path
from typing import ParamSpec

from geometry.errors import BadInputError
from geometry.json_text import LARGEST_INT
from geometry.regular_files import refuse_streams

Given = ParamSpec("Given")


def with_checked_values(command: Callable[Given, None]) -> Callable[Given, None]:
    """The command, which refuses values that none can use, whatever the option.

    Paths of what never ends, or ends when somebody else writes (pipes, sockets, devices); numbers
    that are not finite; whole numbers that no array holds.
    """

    @wraps(command)
    def run_checked(*args: Given.args, **kwargs: Given.kwargs) -> None:
        for name, value in kwargs.items():
            for one in value if isinstance(value, list | tuple) else [value]:
                _check_value(f"--{name.replace('_', '-')}", one)
        command(*args, **kwargs)

    return run_checked


def _check_value(option: str, value: object) -> None:
    if isinstance(value, str | Path):
        refuse_streams(Path(value))
    if isinstance(value, float) and not math.isfinite(value):
        raise BadInputError(f"{option} {value}: give a finite number")
    if isinstance(value, int) and abs(value) > LARGEST_INT:
        raise BadInputError(f"{option}: {value} is too large")
