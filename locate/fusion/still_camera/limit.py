"""The detection limit of a camera at rest: the weakest plume that its single frames would show."""

from collections.abc import Sequence

import cv2
import numpy as np

from detect.detection import Detection
from detect.response import Response
from geometry.arrays import FloatMap
from locate.fusion.limit import AMPLITUDES_PX, SHARE_SEEN, expected_evidence

PLUME_WIDTH, PLUME_HEIGHT = 0.04, 0.2
"""Of a usual plume, in widths of the image; chosen by hand."""


def still_limit_px(
    detections: Sequence[Detection],
    size: tuple[int, int],
    *,
    evident_nats: float,
    least_nats: float,
    samples: float,
    response: Response | None = None,
) -> float | None:
    """The smallest displacement with which a plume would be a region of evidence in half of places.

    A usual plume is put at every place. Each pixel of it that holds evidence is given what the
    detector gives that displacement at its own sigma, in every frame, as `find_bearings` sums it.

    Args:
        detections: Of the frames.
        size: Width and height of the maps that are summed, px.
        evident_nats: Mean evidence of a region's pixels, nats.
        least_nats: What chance alone does not make.
        samples: Pixels that count as one.
        response: Of the detector; None: the hand-made formula.

    Returns:
        px of the original frames, between a frame and the usual one; None where even the largest
        of `AMPLITUDES_PX` would not have been seen.
    """
    llr = np.stack([_shrink(each.llr, size) for each in detections])
    sigma_px = np.stack([_shrink(each.sigma_px, size) for each in detections])
    window = (round(PLUME_WIDTH * size[0]) | 1, round(PLUME_HEIGHT * size[0]) | 1)
    for amplitude in AMPLITUDES_PX:
        expected = expected_evidence(llr, sigma_px, float(amplitude), response)
        total = np.where(expected.mean(axis=0) > evident_nats, expected.sum(axis=0), 0)
        nats = cv2.boxFilter(total, -1, window, normalize=False) / samples
        if (nats > least_nats).mean() >= SHARE_SEEN:
            return float(amplitude)
    return None


def _shrink(values: FloatMap, size: tuple[int, int]) -> FloatMap:
    """A map without mixing pixels: what was not measured stays apart."""
    return np.asarray(cv2.resize(values, size, interpolation=cv2.INTER_NEAREST))
