"""The largest blob of evidence in each view: what locating by masks begins from."""

from dataclasses import dataclass
from typing import Self

import cv2
import numpy as np

from geometry.arrays import BoolArray, FloatArray
from geometry.trajectory import Trajectory
from locate.fusion.views import Views

MEDIAN_PX = 5
"""Side of the median filter that takes single pixels out of a mask."""
LEAST_NATS = 1.0
"""A pixel with more evidence is in the mask."""
LEAST_PX = 30
"""A smaller blob is none."""


@dataclass(frozen=True, kw_only=True)
class SourceEstimate:
    """Where a peer says that the source is.

    Attributes:
        source: (3,) in the world.
        covariance: (3, 3).
    """

    source: FloatArray
    covariance: FloatArray


@dataclass(frozen=True, kw_only=True)
class Blobs:
    """The largest blobs of V views.

    Attributes:
        trajectory: V poses.
        masks: (V, H, W), empty where a view shows none.
        centroids: (V, 2) px; NaN without a blob.
        lowest: (V, 2) px, the middle of a blob's lowest row; NaN likewise.
    """

    trajectory: Trajectory
    masks: BoolArray
    centroids: FloatArray
    lowest: FloatArray

    @classmethod
    def of(cls, views: Views) -> Self:
        """Of the pixels with enough evidence for a plume."""
        masks = np.zeros(views.llr.shape, bool)
        centroids, lowest = np.full((2, len(views), 2), np.nan)
        for i, llr in enumerate(views.llr):
            clean = cv2.medianBlur((llr > LEAST_NATS).astype(np.uint8), MEDIAN_PX)
            _, labels, stats, middles = cv2.connectedComponentsWithStats(clean)
            areas = stats[1:, cv2.CC_STAT_AREA]
            if not len(areas) or areas.max() < LEAST_PX:
                continue
            best = 1 + int(areas.argmax())
            masks[i] = labels == best
            centroids[i] = middles[best]
            rows, columns = np.nonzero(masks[i])
            lowest[i] = columns[rows == rows.max()].mean(), rows.max()
        return cls(trajectory=views.trajectory, masks=masks, centroids=centroids, lowest=lowest)
