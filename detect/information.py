"""What a frame says about displacements that no single pixel shows: normal equations."""

from dataclasses import dataclass
from typing import Self

import cv2
import numpy as np

from geometry.arrays import FloatMap, IntArray

MAP_WIDTH_PX = 320
"""Width that maps are summed to, px; chosen by hand: the narrowest plumes are some px wide then."""
RIDGE_SHARE = 0.02
"""Of the trace, added to both diagonal terms of a local mean, for places with one edge alone."""
LEAST_TERM = 1e-3
"""Keeps the local mean finite where nothing was measured, 1 / px^2."""


@dataclass(frozen=True, kw_only=True)
class DisplacementInformation:
    """Normal equations of the displacement, which add up over pixels.

    For displacements ``A t`` of a known shape t (px) and unknown size A, the sum of ``t . vector``
    over the pixels is the score and that of ``t . matrix t`` its variance, so their quotient is the
    least-squares estimate of A. Nothing is damped: what a pixel does not show has no weight.

    Attributes:
        vector: (h, w, 2) matrix times the displacement that was measured, 1 / px; x right, y down.
        matrix: (h, w, 3) the xx, xy and yy terms of the precision of the displacement, 1 / px^2.
            Displacements are counted in px of the whole frame.
    """

    vector: FloatMap
    matrix: FloatMap

    def __post_init__(self) -> None:
        shape = self.matrix.shape[:2]
        if self.vector.shape != (*shape, 2) or self.matrix.shape != (*shape, 3):
            raise ValueError(f"{self.vector.shape=} and {self.matrix.shape=} do not go together")

    def summed_to(self, width: int, height: int) -> Self:
        """The same on a coarser grid: each cell holds the sum of its pixels."""
        pixels = self.vector.shape[0] * self.vector.shape[1] / (width * height)

        def sum_cells(maps: FloatMap) -> FloatMap:
            mean = cv2.resize(maps, (width, height), interpolation=cv2.INTER_AREA)
            return np.asarray(mean * np.float32(pixels))

        return type(self)(vector=sum_cells(self.vector), matrix=sum_cells(self.matrix))

    def without(self, polygon: IntArray) -> Self:
        """The same with nothing known inside a polygon, (K, 2) cells."""
        vector, matrix = self.vector.copy(), self.matrix.copy()
        for maps in (vector, matrix):
            cv2.fillPoly(maps, [polygon.astype(np.int32)], (0.0, 0.0, 0.0))
        return type(self)(vector=vector, matrix=matrix)

    def in_units_of(self, px: float) -> Self:
        """The same of a frame so many times as large, displacements in its px."""
        return type(self)(
            vector=np.asarray(self.vector / np.float32(px)),
            matrix=np.asarray(self.matrix / np.float32(px * px)),
        )

    def without_local_mean(self, sigma_px: float) -> Self:
        """The same without what the surroundings of a pixel share.

        Errors of pose, lens and depth displace whole neighbourhoods alike; a plume turns the
        displacement round within its own width.

        Args:
            sigma_px: Standard deviation of the neighbourhood, cells.
        """
        shared = self.times(self.local_mean(sigma_px))
        return type(self)(vector=self.vector - shared, matrix=self.matrix)

    def local_mean(self, sigma_px: float) -> FloatMap:
        """(h, w, 2) px, the displacement that the surroundings of each cell share.

        Args:
            sigma_px: Standard deviation of the neighbourhood, cells.
        """
        vector = cv2.GaussianBlur(self.vector, (0, 0), sigma_px)
        xx, xy, yy = cv2.split(cv2.GaussianBlur(self.matrix, (0, 0), sigma_px))
        ridge = RIDGE_SHARE * (xx + yy) + LEAST_TERM
        xx, yy = xx + ridge, yy + ridge
        x, y = cv2.split(vector)
        determinant = xx * yy - xy * xy
        mean_x = (yy * x - xy * y) / determinant
        mean_y = (xx * y - xy * x) / determinant
        return np.asarray(cv2.merge([mean_x, mean_y]))

    def times(self, displacement: FloatMap) -> FloatMap:
        """(h, w, 2) the matrix times a displacement (h, w, 2): the vector that it would give."""
        x, y = displacement[..., 0], displacement[..., 1]
        xx, xy, yy = np.moveaxis(self.matrix, -1, 0)
        return np.stack([xx * x + xy * y, xy * x + yy * y], axis=-1)
