"""Progress of work that takes long: a function that is called with it."""

from collections.abc import Callable
from typing import TypeAlias

Report: TypeAlias = Callable[[str, float], None]
"""Takes the name of a stage and the share of it that is done; below 0 it has no known end."""


def ignore_report(stage: str, share: float) -> None:
    """A report that nobody reads."""
