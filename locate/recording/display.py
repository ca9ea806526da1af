"""From the stored pixels of a video frame to the picture that a player shows."""

from dataclasses import dataclass
from fractions import Fraction
from typing import Any, Self

import av
import cv2
import numpy as np
from av.sidedata.sidedata import Type

from geometry.arrays import FloatArray, GreySamples

MAX_ASPECT = 8
"""Pixels longer than this, over their other side, are an error in the file."""
OFF_QUARTER = 0.02
"""Sine of the angle off a quarter turn from which on it is noted."""


@dataclass(frozen=True, kw_only=True)
class PictureGeometry:
    """How the stored pixels of a frame are shown.

    Attributes:
        aspect: Width over height of a stored pixel.
        shown_from_stored: (2, 2) turn and mirroring of x to the right and y down.
    """

    aspect: Fraction
    shown_from_stored: FloatArray

    @classmethod
    def of(cls, frame: av.VideoFrame, stream: av.VideoStream) -> Self:
        """What the file states; square pixels, upright, where it states nothing usable."""
        aspect = stream.sample_aspect_ratio
        if not aspect or not Fraction(1, MAX_ASPECT) <= aspect <= MAX_ASPECT:
            aspect = Fraction(1)
        return cls(aspect=aspect, shown_from_stored=_display_matrix(frame))

    def show(self, image: GreySamples) -> GreySamples:
        """The picture: enlarged to square pixels, then turned by quarters and flipped.

        Args:
            image: (H, W), or (H, W, 3) in colour.
        """
        size = self._square_size(image)
        if size != (image.shape[1], image.shape[0]):
            image = cv2.resize(image, size, interpolation=cv2.INTER_CUBIC)
        quarter = _nearest_quarter(self.shown_from_stored)
        if quarter[0, 0] == 0:
            image, quarter = image.swapaxes(0, 1), quarter[:, ::-1]
        return image[:: int(quarter[1, 1]), :: int(quarter[0, 0])].copy(order="C")

    def describe(self, image: GreySamples) -> list[str]:
        """Notes on a stored image whose shape or sides are shown otherwise; none on quarters."""
        notes = []
        (width, height), stored = self._square_size(image), (image.shape[1], image.shape[0])
        if (width, height) != stored:
            notes.append(
                f"its pixels are not square ({self.aspect.numerator}:{self.aspect.denominator}); "
                f"frames of {stored[0]}x{stored[1]} were resampled to {width}x{height} as players "
                "show them, and a given camera or focal length has to be of these"
            )
        if np.linalg.det(self.shown_from_stored) < 0:
            notes.append(
                "its display matrix mirrors; frames were flipped as players show them, and a given "
                "camera has to be of these"
            )
        away = np.abs(self.shown_from_stored - _nearest_quarter(self.shown_from_stored)).max()
        if away > OFF_QUARTER:
            notes.append("its display matrix turns by no quarter turn; the nearest one was taken")
        return notes

    def _square_size(self, image: GreySamples) -> tuple[int, int]:
        height, width = image.shape[:2]
        return round(width * max(self.aspect, 1)), round(height / min(self.aspect, 1))


def _display_matrix(frame: av.VideoFrame) -> FloatArray:
    side_data: Any = frame.side_data  # a mapping by `Type`, which its stub does not say
    if Type.DISPLAYMATRIX not in side_data:
        return np.eye(2)
    stated = side_data[Type.DISPLAYMATRIX]
    a, b, _, c, d, *_ = np.frombuffer(bytes(stated), dtype=np.int32)
    matrix = np.array([[a, c], [b, d]], dtype=float)
    lengths = np.linalg.norm(matrix, axis=0)
    return matrix / lengths if lengths.all() else np.eye(2)


def _nearest_quarter(matrix: FloatArray) -> FloatArray:
    """The signed permutation nearest to a (2, 2) matrix of unit columns."""
    straight = abs(matrix[0, 0]) + abs(matrix[1, 1]) >= abs(matrix[0, 1]) + abs(matrix[1, 0])
    return np.sign(matrix) * (np.eye(2) if straight else 1 - np.eye(2))
