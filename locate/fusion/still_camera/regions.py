"""Parts of an image with evidence for a plume."""

from typing import NamedTuple

import cv2
import numpy as np

from geometry.arrays import BoolArray

FALSE_ALARM = 0.01
"""Probability that an image without plumes yields a region; chosen by hand."""


class ImageRegion(NamedTuple):
    """Pixels that belong together, their evidence, and how often chance alone makes as much.

    Attributes:
        mask: (H, W) the pixels.
        nats: Their evidence.
        false_alarm: Probability that chance makes one as strong anywhere in the image.
        displacement_px: Usual displacement there, px of the original frames.
        edge_sigma_px: How well it is known where the mask ends, px of it.
    """

    mask: BoolArray
    nats: float
    false_alarm: float
    displacement_px: float
    edge_sigma_px: float


def connected_parts(inside: BoolArray) -> list[BoolArray]:
    """(H, W) masks of the connected parts."""
    count, labels = cv2.connectedComponents(inside.astype(np.uint8))
    return [np.asarray(labels == k) for k in range(1, count)]
