"""EdgePoints of edges, each found to a small part of a pixel along one axis."""

from dataclasses import dataclass, fields
from typing import Self

import cv2
import numpy as np
from numpy.typing import NDArray

from geometry.arrays import FloatArray, FloatMap

SOFT_PX = 1.0
LEAST_SLOPE, LEAST_IN_NOISE = 1.5, 1.2
"""Of an edge: grey levels per px, and in standard deviations of the noise per px."""
NEAREST_PX = 3
"""To the image's border."""
LEAST_POINTS = 14
PLACE_NOISE = 0.35
"""Standard deviation px of an edge's place, of noise over slope of 1."""

SLOPE = np.array([[-0.5, 0, 0.5]], np.float32)

Indices = NDArray[np.intp]


@dataclass(frozen=True, kw_only=True)
class EdgePoints:
    """N points of edges that all cross one axis; edges of fewer than 14 points are left out.

    Attributes:
        place: (N,) px along that axis.
        line: (N,) row or column that the point is on.
        sigma_px: (N,) of `place`.
        edge: (N,) which edge it belongs to, from 0.
    """

    place: FloatArray
    line: FloatArray
    sigma_px: FloatArray
    edge: Indices

    @classmethod
    def find(cls, grey: FloatMap, noise: float) -> Self:
        """Where grey levels change most steeply along x, and more so than along y."""
        soft = cv2.GaussianBlur(grey, (0, 0), SOFT_PX)
        along_y = np.abs(cv2.filter2D(soft, -1, SLOPE.T))
        slope = cv2.filter2D(soft, -1, SLOPE)
        rising, falling = (cls._find_rising(s * slope, along_y, noise) for s in (1, -1))
        names = (field.name for field in fields(cls))
        pairs = {name: [getattr(rising, name), getattr(falling, name)] for name in names}
        pairs["edge"][1] = pairs["edge"][1] + rising.edge.max(initial=-1) + 1
        return cls(**{name: np.concatenate(pair) for name, pair in pairs.items()})

    @classmethod
    def _find_rising(cls, slope: FloatMap, along_y: FloatMap, noise: float) -> Self:
        steepest = (slope > max(LEAST_SLOPE, LEAST_IN_NOISE * noise)) & (slope >= along_y)
        steepest[:, 1:] &= slope[:, 1:] >= slope[:, :-1]
        steepest[:, :-1] &= slope[:, :-1] > slope[:, 1:]
        steepest[:NEAREST_PX] = steepest[-NEAREST_PX:] = False
        steepest[:, :NEAREST_PX] = steepest[:, -NEAREST_PX:] = False
        _, labels = cv2.connectedComponents(steepest.astype(np.uint8), connectivity=8)
        row, column = np.nonzero(steepest)
        label = labels[row, column]
        long = np.bincount(label) >= LEAST_POINTS
        row, column, edge = row[long[label]], column[long[label]], (np.cumsum(long) - 1)[label]
        left, middle, right = (
            np.log(np.maximum(slope[row, column + step], 1e-3)) for step in (-1, 0, 1)
        )
        offset = (left - right) / np.minimum(2 * (left - 2 * middle + right), -1e-3)
        return cls(
            place=column + np.clip(offset, -1, 1),
            line=row.astype(float),
            sigma_px=PLACE_NOISE * noise / slope[row, column],
            edge=edge[long[label]],
        )


def estimate_camera_noise(grey: FloatMap) -> float:
    """Its standard deviation, where half of the image is no finer than a parabola.

    Source: Immerkaer, Computer Vision and Image Understanding 64 (1996) 300; a median, not a mean.
    """
    kernel = np.array([[1, -2, 1], [-2, 4, -2], [1, -2, 1]], np.float32)
    return float(np.median(np.abs(cv2.filter2D(grey, -1, kernel)))) / (6 * 0.6745) + 0.1
