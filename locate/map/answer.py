"""What a map answers, and what kept it from answering."""

from dataclasses import dataclass
from enum import StrEnum


class Answer(StrEnum):
    """What a map says of plumes; the value is its name in map.json.

    Examples:
        >>> import locate
        >>> plume_map = locate.load_map("out")
        >>> bool(plume_map.plumes) == (plume_map.answer is locate.Answer.FOUND)
        True
    """

    FOUND = "found"
    """Plumes, or directions to some."""
    NONE_FOUND = "none_found"
    """None, and the map states the weakest that would have been found."""
    NOT_JUDGED = "not_judged"
    """None, and that means nothing: no plume would have been found."""


class Cause(StrEnum):
    """What kept a run from judging; the value is its name in map.json."""

    FEW_FRAMES = "few_frames"
    LITTLE_OVERLAP = "little_overlap"
    COARSE_CODING = "coarse_coding"
    NO_PARALLAX = "no_parallax"
    SILENT_FRAMES = "silent_frames"
    UNJUDGED_PIXELS = "unjudged_pixels"
    NOISE = "noise"


@dataclass(frozen=True, kw_only=True)
class Obstacle:
    """One thing that kept a run from judging.

    Attributes:
        cause: For programs.
        why: A sentence for people.
        remedy: What to film instead, a sentence too.

    Example:
        >>> import locate
        >>> for obstacle in locate.load_map("out").obstacles:
        ...     assert obstacle.why and obstacle.remedy
    """

    cause: Cause
    why: str
    remedy: str
