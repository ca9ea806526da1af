"""How large the images of a recording are: as recorded, and as they are used."""

from dataclasses import dataclass
from pathlib import Path
from typing import Self

import numpy as np

from geometry.arrays import GreySamples
from geometry.errors import BadInputError

Size = tuple[int, int]
"""Width and height, px."""
LEAST_SIDE_PX, LARGEST_ASPECT = 8, 32
"""Least side of a frame, and largest ratio of its sides: less would be left of others when they are
reduced; chosen, far from what cameras record."""


@dataclass(frozen=True, kw_only=True)
class SizeLimits:
    """Longest sides that images may have; longer ones are reduced.

    Attributes:
        working: Of the images that are processed, px.
        full: Of those that are kept beside them, px.
    """

    working: int
    full: int


@dataclass(frozen=True, kw_only=True)
class FrameSizes:
    """The sizes of the frames of one recording.

    Attributes:
        source: Of the recorded images.
        working: At which frames are processed.
        full: At which pixels are kept beside the working size.
        deep: The samples have more than 8 bits.
    """

    source: Size
    working: Size
    full: Size
    deep: bool

    @classmethod
    def of_image(cls, path: Path, first: GreySamples, limits: SizeLimits) -> Self:
        """By the first image of a recording, (H, W).

        Args:
            path: Of the recording, for messages.
            first: As deep as it is.
            limits: Of the sides.

        Raises:
            BadInputError: It is too small or too long.
        """
        height, width = first.shape
        shorter, longer = sorted(first.shape)
        if shorter < LEAST_SIDE_PX or longer > LARGEST_ASPECT * shorter:
            raise BadInputError(
                f"{path}: frames of {width}x{height} px; those read have {LEAST_SIDE_PX} px a side "
                f"or more, and are at most {LARGEST_ASPECT} times as long as wide"
            )
        return cls(
            source=(width, height),
            working=_reduced((width, height), limits.working),
            full=_reduced((width, height), limits.full),
            deep=first.dtype == np.uint16,
        )

    @property
    def has_full_size(self) -> bool:
        """Whether images at full size hold more than those at the working size."""
        return self.full != self.working or self.deep

    @property
    def full_size_bytes(self) -> int:
        """What an image at full size takes at most, without the head of a file."""
        width, height = self.full
        return width * height * (1 if self.full == self.source and not self.deep else 2)


def _reduced(size: Size, max_side: int) -> Size:
    """The size with its longest side reduced to `max_side` px, if longer."""
    factor = min(1.0, max_side / max(size))
    return round(size[0] * factor), round(size[1] * factor)
