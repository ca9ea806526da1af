"""How much a run does, chosen by one word."""

from dataclasses import dataclass
from typing import Literal

Effort = Literal["quick", "usual", "thorough"]


@dataclass(frozen=True, kw_only=True)
class Amounts:
    """How much a run looks at.

    Attributes:
        max_frames: The most frames that are used.
        max_side: Longest side to which frames are reduced, px.
        detection_frames: In how many of them refraction is measured.
        displacement_frames: Of how many others the displacement alone is measured, which shows
            plumes too weak for single pixels: where the answer is unsure, or always where the
            effort is thorough.
        neighbours: With how many others each frame is compared.
    """

    max_frames: int
    max_side: int
    detection_frames: int
    displacement_frames: int
    neighbours: int

    def describe(self) -> str:
        """In a few words."""
        others = self.displacement_frames
        more = f", of up to {others} more the displacement" if others else ""
        return (
            f"{self.detection_frames} frames measured against {self.neighbours} others each{more}, "
            f"at most {self.max_frames} frames of {self.max_side} px"
        )


EFFORTS: dict[Effort, Amounts] = {
    "quick": Amounts(
        max_frames=60, max_side=1280, detection_frames=10, displacement_frames=0, neighbours=6
    ),
    "usual": Amounts(
        max_frames=120, max_side=3840, detection_frames=16, displacement_frames=48, neighbours=8
    ),
    "thorough": Amounts(
        max_frames=240,
        max_side=3840,
        detection_frames=16,
        displacement_frames=112,
        neighbours=8,
    ),
}
"""Of each effort; docs/accuracy.md has what they cost."""
