"""How the pixels of one pinhole view move into another as their inverse depth changes."""

from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from numpy.typing import ArrayLike

from geometry.arrays import FloatArray, FloatMap
from geometry.trajectory import Trajectory

MIN_DEPTH_RATIO = 0.05
"""Least depth in the target over depth in the source; closer points count as at this depth.
Chosen."""
BAND = 48
"""Rows that are computed together, so that they stay in the processor's cache."""


@dataclass(frozen=True, kw_only=True)
class EpipolarGeometry:
    """Two-view geometry in homogeneous pixels: x_target ~ H x_source + inverse_depth * e.

    Source: Hartley & Zisserman, Multiple View Geometry, eq. 9.7 (infinite homography + epipole).

    Attributes:
        homography: (3, 3) of the plane at infinity, target_from_source; (3, 3, N, 1) of N targets.
        epipole: (3,) the camera matrix times the source centre in the target frame, px; (3, N, 1).
    """

    homography: FloatArray
    epipole: FloatArray

    @classmethod
    def between_frames(cls, trajectory: Trajectory, source: int, target: int) -> Self:
        """The geometry from row `source` of a trajectory to row `target`, distortion left out."""
        K = trajectory.camera.matrix
        rotation = trajectory.rotations[target] @ trajectory.rotations[source].T
        translation = trajectory.translations[target] - rotation @ trajectory.translations[source]
        return cls(homography=K @ rotation @ np.linalg.inv(K), epipole=K @ translation)

    @classmethod
    def towards_all(cls, trajectory: Trajectory, source: int) -> Self:
        """The geometry from row `source` to each of N rows, for (N, M, 2) pixels at once."""
        K = trajectory.camera.matrix
        rotations = trajectory.rotations @ trajectory.rotations[source].T
        translations = trajectory.translations - rotations @ trajectory.translations[source]
        homographies = np.moveaxis(K @ rotations @ np.linalg.inv(K), 0, -1)
        return cls(homography=homographies[..., None], epipole=(K @ translations.T)[..., None])

    def in_unit(self, unit: float) -> Self:
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
        flow, slope = np.empty((2, 2, *x.shape), np.float32)
        self._fill_flow(x, y, np.asarray(inverse_depth, dtype=np.float32), flow, slope)
        return np.stack(list(flow), axis=-1), np.stack(list(slope), axis=-1)

    def over_grid(
        self,
        x: FloatMap,
        y: FloatMap,
        inverse_depth: FloatMap,
        out: tuple[FloatMap, FloatMap] | None = None,
    ) -> tuple[FloatMap, FloatMap]:
        """`flow_and_slope` of a grid of pixels, x and y in planes of their own.

        Args:
            x: (W,) source columns, px.
            y: (H,) source rows, px.
            inverse_depth: (H, W) along the source's optical axis, 1 / world unit.
            out: Where to write both, (2, H, W) float32 each; new arrays without.

        Returns:
            (2, H, W) px; (2, H, W) px per 1 / world unit.
        """
        flow, slope = out or np.empty((2, 2, *inverse_depth.shape), np.float32)
        for start in range(0, len(y), BAND):  # what is done to a few rows stays in the cache
            rows = slice(start, start + BAND)
            self._fill_flow(x, y[rows, None], inverse_depth[rows], flow[:, rows], slope[:, rows])
        return flow, slope

    def _fill_flow(
        self, x: FloatMap, y: FloatMap, rho: FloatMap, flow: FloatMap, slope: FloatMap
    ) -> None:
        """Fills in `flow_and_slope` of x and y that go together with rho by broadcasting."""
        H, e = self.homography.astype(np.float32), self.epipole.astype(np.float32)
        targets = [row[0] * x + (row[1] * y + row[2]) for row in H]
        for k, step in enumerate(e):
            targets[k] += rho * step
        scale = np.reciprocal(np.maximum(targets[2], np.float32(MIN_DEPTH_RATIO)))
        for k, source in enumerate((x, y)):
            target = targets[k]
            target *= scale
            np.subtract(target, source, out=flow[k])
            target *= e[2]
            np.subtract(e[k], target, out=target)
            np.multiply(target, scale, out=slope[k])

    def parallax_px(self, pixels: FloatMap, inverse_depth: ArrayLike) -> FloatMap:
        """(...) px, how far that inverse depth moves pixels beyond those at infinity."""
        moved = self.flow(pixels, inverse_depth) - self.flow(pixels, 0.0)
        return np.asarray(np.hypot(moved[..., 0], moved[..., 1]))
