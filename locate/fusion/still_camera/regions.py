"""Parts of an image that speak for a plume."""

from typing import NamedTuple

import cv2
import numpy as np

from geometry.arrays import BoolArray

FALSE_ALARM = 0.01


class Region(NamedTuple):
    """Pixels that belong together, what they say, and how often chance alone says so.

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
