"""How the pixels of one pinhole view move into another as their inverse depth changes."""

from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from numpy.typing import ArrayLike

from geometry.arrays import FloatArray, FloatMap
from geometry.trajectory import Trajectory

MIN_DEPTH_RATIO = 0.05
BAND = 32


@dataclass(frozen=True, kw_only=True)
class Epipolar:
    """Two-view geometry in homogeneous pixels: x_target ~ H x_source + inverse_depth * e.

    Source: Hartley & Zisserman, Multiple View Geometry, eq. 9.7 (infinite homography + epipole).

    Attributes:
        homography: (3, 3) of the plane at infinity, target_from_source.
        epipole: (3,) the camera matrix times the source centre in the target frame, px.
    """

    homography: FloatArray
    epipole: FloatArray

    @classmethod
    def between(cls, trajectory: Trajectory, source: int, target: int) -> Self:
        """The geometry from row `source` of a trajectory to row `target`, distortion left out."""
        K = trajectory.camera.matrix
        rotation = trajectory.rotations[target] @ trajectory.rotations[source].T
        translation = trajectory.translations[target] - rotation @ trajectory.translations[source]
        return cls(homography=K @ rotation @ np.linalg.inv(K), epipole=K @ translation)

    def rescaled(self, unit: float) -> Self:
        """The same geometry for inverse depths counted in that unit."""
        return replace(self, epipole=self.epipole * unit)

    def flow(self, pixels: FloatMap, inverse_depth: ArrayLike) -> FloatMap:
        """(..., 2) px, how far pixels of that inverse depth move; see `flow_and_slope`."""
        return self.flow_and_slope(pixels, inverse_depth)[0]

    def flow_and_slope(
        self, pixels: FloatMap, inverse_depth: ArrayLike
    ) -> tuple[FloatMap, FloatMap]:
        """The motion of pixels and its derivative by inverse depth.

        Args:
            pixels: (..., 2) source pixels.
            inverse_depth: (...) along the source's optical axis, 1 / world unit.

        Returns:
            (..., 2) target position minus source position, px; (..., 2) px per 1 / world unit.
            Points at or behind the target's plane count as just before it.
        """
        x, y = np.moveaxis(np.asarray(pixels, dtype=np.float32), -1, 0)
        return self._moved(x, y, np.asarray(inverse_depth, dtype=np.float32))

    def over_rows(self, inverse_depth: FloatMap, first_row: int = 0) -> tuple[FloatMap, FloatMap]:
        """`flow_and_slope` of all pixels of an image, or of some of its rows.

        Args:
            inverse_depth: (H, W) along the source's optical axis, 1 / world unit.
            first_row: Row of the image that the first one is.
        """
        height, width = inverse_depth.shape
        flow, slope = np.empty((2, height, width, 2), np.float32)
        x = np.arange(width, dtype=np.float32)
        y = np.arange(first_row, first_row + height, dtype=np.float32)[:, None]
        for start in range(0, height, BAND):  # what is done to a few rows stays in the cache
            rows = slice(start, start + BAND)
            flow[rows], slope[rows] = self._moved(x, y[rows], inverse_depth[rows])
        return flow, slope

    def _moved(self, x: FloatMap, y: FloatMap, rho: FloatMap) -> tuple[FloatMap, FloatMap]:
        """`flow_and_slope` of x and y that go together with rho by broadcasting."""
        H, e = self.homography.astype(np.float32), self.epipole.astype(np.float32)
        at_infinity = [row[0] * x + (row[1] * y + row[2]) for row in H]
        depth_ratio = at_infinity[2] + rho * e[2]
        scale = 1 / np.maximum(depth_ratio, np.float32(MIN_DEPTH_RATIO))
        target_x = (at_infinity[0] + rho * e[0]) * scale
        target_y = (at_infinity[1] + rho * e[1]) * scale
        flow, slope = np.empty((2, *scale.shape, 2), np.float32)
        flow[..., 0], flow[..., 1] = target_x - x, target_y - y
        slope[..., 0] = (e[0] - target_x * e[2]) * scale
        slope[..., 1] = (e[1] - target_y * e[2]) * scale
        return flow, slope

    def parallax_px(self, pixels: FloatMap, inverse_depth: ArrayLike) -> FloatMap:
        """(...) px, how far that inverse depth moves pixels beyond those at infinity."""
        moved = self.flow(pixels, inverse_depth) - self.flow(pixels, 0.0)
        return np.asarray(np.hypot(moved[..., 0], moved[..., 1]))
