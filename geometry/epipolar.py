"""How the pixels of one pinhole view move into another as their inverse depth changes."""

from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from numpy.typing import ArrayLike

from geometry.arrays import FloatArray, FloatMap
from geometry.trajectory import Trajectory

MIN_DEPTH_RATIO = 0.05


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
        H, e = self.homography.astype(np.float32), self.epipole.astype(np.float32)
        rho = np.asarray(inverse_depth, dtype=np.float32)
        x, y = pixels[..., 0], pixels[..., 1]
        depth_ratio = H[2, 0] * x + H[2, 1] * y + (H[2, 2] + rho * e[2])
        scale = 1 / np.maximum(depth_ratio, np.float32(MIN_DEPTH_RATIO))
        target_x = (H[0, 0] * x + H[0, 1] * y + (H[0, 2] + rho * e[0])) * scale
        target_y = (H[1, 0] * x + H[1, 1] * y + (H[1, 2] + rho * e[1])) * scale
        flow, slope = np.empty((2, *scale.shape, 2), np.float32)
        flow[..., 0], flow[..., 1] = target_x - x, target_y - y
        slope[..., 0] = (e[0] - target_x * e[2]) * scale
        slope[..., 1] = (e[1] - target_y * e[2]) * scale
        return flow, slope

    def parallax_px(self, pixels: FloatMap, inverse_depth: ArrayLike) -> FloatMap:
        """(...) px, how far that inverse depth moves pixels beyond those at infinity."""
        moved = self.flow(pixels, inverse_depth) - self.flow(pixels, 0.0)
        return np.asarray(np.hypot(moved[..., 0], moved[..., 1]))
