"""What makes a background-oriented recording useless, found before it becomes training data."""

from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum
from typing import Self

import cv2
import numpy as np

from detect.bos import WINDOW_PX, BosDetector, texture_of
from detect.detection import Frames
from detect.warp import blur, pixel_grid, sample
from geometry.arrays import FloatArray, FloatMap, GreyImage

BLOCK_PX = 32
"""Side of the blocks whose brightness is compared."""
DARK = 8.0
"""Grey level below which changes are not taken relative to the block's own."""
MOST_LIGHT = 0.005
"""Largest relative change of brightness; chosen by hand, as are the limits below."""
MOST_SHIFT_PX = 1.0
"""Largest shift of the whole frame."""
MOST_RIGID_PX = 0.05
"""Most by which the median flow may fall when its rotation, zoom and shear are taken out."""
THINNING, ITERATIONS, SMALL_PX = 4, 15, 0.01
"""Of that fit: one of so many rows and columns, rounds of weights, and least deviation."""
UNEXPLAINED = 12.0
"""Difference that the flow leaves, from which on a pixel is unexplained, grey levels."""
MOST_UNEXPLAINED_SHARE = 0.1
"""Largest share of such pixels."""
CLIPPED = (1, 254)
"""Grey levels from which on, down and up, a pixel is under- and overexposed."""
MOST_CLIPPED_SHARE = 0.1
"""Largest share of such pixels in a reference."""
LEAST_TEXTURE = 4.0
"""Texture of a pixel against which flow is measured, (grey levels per px) squared."""
LEAST_TEXTURED_SHARE = 0.25
"""Least share of such pixels in a reference."""
MOST_PLUME_SHARE = 0.005
"""Largest share of the pixels in which frames of the reference have evidence for a plume."""
REFERENCE_FRAMES_SEEN = 9
"""Frames of the reference in which a plume is looked for."""


class RecordingFault(Enum):
    """What is wrong with a recording; the value is a message, with what to do."""

    LIGHT = "the illumination changed: lock exposure, gain and lamps"
    MOVED = "the camera or the background moved: fix both, record the reference anew"
    INTRUDED = "the scene is not that of the reference: keep people and objects out of view"
    CLIPPED = "the reference is over- or underexposed: change the exposure"
    BLANK = "the background has too little texture: print one with `locate pattern`"
    PLUME = "a plume is in the reference already: record it before the heat is on"


@dataclass(frozen=True, kw_only=True)
class FrameCheck:
    """How far one frame is from the reference in what no plume does.

    Attributes:
        light: Relative change of brightness, in that half of the frame where it is larger.
        shift_px: (2,) median flow, taken out of the displacement.
        rigid_px: By how much the median size of the flow falls when the rotation, zoom and shear
            that most of the frame shares are taken out.
        unexplained: Share of the pixels whose surroundings the flow leaves off by 12 grey levels.
    """

    light: float
    shift_px: tuple[float, float]
    rigid_px: float
    unexplained: float

    @classmethod
    def compare(
        cls,
        reference: GreyImage,
        image: GreyImage,
        displacement: FloatMap,
        shift_px: FloatArray,
        texture: FloatMap,
    ) -> Self:
        """Compares a frame with its reference.

        Args:
            reference: (H, W).
            image: (H, W).
            displacement: (H, W, 2) px, without `shift_px`.
            shift_px: (2,).
            texture: (H, W) of the reference, `detect.bos.texture_of`.
        """
        grid = pixel_grid(image.shape) + shift_px.astype(np.float32)
        leftover = blur((image - sample(reference, grid + displacement)) ** 2, WINDOW_PX)
        return cls(
            light=_relative_light(sample(reference, grid), image),
            shift_px=(float(shift_px[0]), float(shift_px[1])),
            rigid_px=_rigid_part(displacement, texture),
            unexplained=float((leftover > UNEXPLAINED**2).mean()),
        )

    @property
    def fault(self) -> RecordingFault | None:
        """Why the frame cannot be used, None where it can."""
        if max(map(abs, self.shift_px)) > MOST_SHIFT_PX or self.rigid_px > MOST_RIGID_PX:
            return RecordingFault.MOVED
        if self.light > MOST_LIGHT:
            return RecordingFault.LIGHT
        return RecordingFault.INTRUDED if self.unexplained > MOST_UNEXPLAINED_SHARE else None


def reference_fault(
    reference: GreyImage, images: Sequence[GreyImage] = ()
) -> RecordingFault | None:
    """Why nothing can be measured against this reference, None where it can be used.

    A plume that never moves is part of the background for any measurement, and passes.

    Args:
        reference: (H, W).
        images: The frames whose mean it is; none where it came from a file.
    """
    darkest, brightest = CLIPPED
    if ((reference <= darkest) | (reference >= brightest)).mean() > MOST_CLIPPED_SHARE:
        return RecordingFault.CLIPPED
    if (texture_of(reference) > LEAST_TEXTURE).mean() < LEAST_TEXTURED_SHARE:
        return RecordingFault.BLANK
    return RecordingFault.PLUME if _plume_share(reference, images) > MOST_PLUME_SHARE else None


def _plume_share(reference: GreyImage, images: Sequence[GreyImage]) -> float:
    """Share of the pixels where the frames together have evidence for a plume."""
    if not images:
        return 0.0
    frames, detector = Frames(images=images), BosDetector(reference=reference)
    count = min(REFERENCE_FRAMES_SEEN, len(images))
    rows = np.linspace(0, len(images) - 1, count).round().astype(int)
    llr = np.mean([detector.detect(frames, int(row)).llr for row in rows], axis=0)
    return float((llr > 0).mean())


def _relative_light(reference: FloatMap, image: GreyImage) -> float:
    height, width = (max(2, side // BLOCK_PX) for side in reference.shape)
    before, after = (
        cv2.resize(part, (width, height), interpolation=cv2.INTER_AREA)
        for part in (reference, image.astype(np.float32))
    )
    change = (after - before) / np.maximum(before, DARK)
    rows, columns = np.array_split(change, 2), np.array_split(change, 2, axis=1)
    return float(max(abs(np.median(half)) for half in (*rows, *columns)))


def _rigid_part(displacement: FloatMap, texture: FloatMap) -> float:
    """Least absolute deviations from an affine flow, by iterated weights."""
    thinned = texture[::THINNING, ::THINNING]
    textured = thinned >= np.median(thinned)
    places = pixel_grid(texture.shape)[::THINNING, ::THINNING][textured] / max(texture.shape)
    flow = displacement[::THINNING, ::THINNING][textured].astype(float)
    design = np.column_stack([np.ones(len(places)), places])
    size = np.linalg.norm(flow, axis=1)
    left = size
    for _ in range(ITERATIONS):
        weight = np.sqrt(1 / np.maximum(left, SMALL_PX))[:, None]
        fit = np.linalg.lstsq(design * weight, flow * weight, rcond=None)[0]
        left = np.linalg.norm(flow - design @ fit, axis=1)
    return float(np.median(size) - np.median(left))
