"""The displacement of a frame alone, at a part of what a whole detection costs."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Generic, TypeVar, overload

import cv2
import numpy as np

from detect.detection import Detection, Frames
from detect.information import MAP_WIDTH_PX
from detect.registered.detector import RegisteredDetector
from detect.response import Response
from geometry.arrays import FloatArray, FloatMap, GreyImage
from geometry.trajectory import Trajectory

NEIGHBOURS = 6
"""With so many others a frame is compared: with 4 the turn of a plume had up to 40 % fewer sigmas,
with 8 it costs a third more (docs/weak_plumes.md)."""
Image = TypeVar("Image", GreyImage, FloatMap)


class DisplacementOnlyDetector:
    """Normal equations of the displacement and the depth, and no evidence of single pixels.

    Flow and depth are measured at half the size, where that still fills the maps; the information
    is of all pixels. Nothing evaluates it pixel by pixel: llr is 0 and sigma inf.

    Args:
        neighbours: As of `RegisteredDetector`, but at most `NEIGHBOURS`.
        points_in_world: As of `RegisteredDetector`.
    """

    name = "displacement-only"
    response: Response | None = None
    uses_other_frames = True

    def __init__(
        self, *, neighbours: int = NEIGHBOURS, points_in_world: FloatArray | None = None
    ) -> None:
        self._registered = RegisteredDetector(
            neighbours=min(neighbours, NEIGHBOURS), points_in_world=points_in_world
        )

    def detect(self, frames: Frames, index: int) -> Detection:
        """Measures frame `index`, on maps of half its size; raises as `RegisteredDetector`."""
        height, width = frames.images[index].shape
        px = 1.0
        if frames.trajectory is not None and width >= 2 * MAP_WIDTH_PX:
            frames, px = halve_frames(frames, frames.trajectory), 2.0
            height, width = frames.images[index].shape
        nothing = Detection.without_evidence((height, width), depth=True)
        measured = self._registered.measure(frames, index)
        if measured is None:
            return nothing
        measurement, unit = measured
        information = measurement.information
        return replace(
            nothing,
            inverse_depth=measurement.inverse_depth(unit),
            information=None if information is None else information.in_units_of(px),
        )


def halve_frames(frames: Frames, trajectory: Trajectory) -> Frames:
    """The frames at half their size, and these, or larger ones, as their full size."""
    camera = trajectory.camera.scaled(0.5)

    def halve(image: GreyImage) -> GreyImage:
        size = (camera.width, camera.height)
        return np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA), np.uint8)

    def to_grey_levels(image: GreyImage) -> FloatMap:
        return image.astype(np.float32)

    full_size = frames.full_size or ConvertedImages(frames.images, to_grey_levels)
    return replace(
        frames,
        images=ConvertedImages(frames.images, halve),
        trajectory=replace(trajectory, camera=camera),
        full_size=full_size,
    )


@dataclass(frozen=True)
class ConvertedImages(Sequence[Image], Generic[Image]):
    """Images that are made of others when they are read.

    Attributes:
        images: The others.
        convert: Makes one.
    """

    images: Sequence[GreyImage]
    convert: Callable[[GreyImage], Image]

    def __len__(self) -> int:
        return len(self.images)

    @overload
    def __getitem__(self, i: int) -> Image: ...
    @overload
    def __getitem__(self, i: slice) -> "ConvertedImages[Image]": ...
    def __getitem__(self, i: int | slice) -> "Image | ConvertedImages[Image]":
        if isinstance(i, slice):
            return replace(self, images=self.images[i])
        return self.convert(self.images[i])
