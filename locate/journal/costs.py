"""What the stages of a run cost."""

import os
from dataclasses import dataclass


@dataclass(frozen=True, kw_only=True)
class StageTime:
    """What a stage of a run cost.

    Attributes:
        name: Of the stage.
        wall_s: Seconds that passed.
        cpu_s: CPU seconds of this process and its finished children.
        note: Its result in a few words.
    """

    name: str
    wall_s: float
    cpu_s: float
    note: str = ""


def cpu_seconds() -> float:
    """CPU seconds of this process and its finished children."""
    times = os.times()
    return times.user + times.system + times.children_user + times.children_system
