"""Evidence summed in 3D: log-likelihood ratios of many views in one voxel grid.

A horizontal slice of the grid is a plane, so one homography carries a view's map onto it.
"""

from dataclasses import dataclass
from typing import Self

import cv2
import numpy as np

from geometry.arrays import FloatArray, FloatMap
from geometry.trajectory import Trajectory

LEVER_NONE, LEVER_FULL = 0.03, 0.28
"""Relative levers below which a view has no weight and above which it has all of it."""


def relative_lever(depth: FloatMap, background_inverse_depth: FloatMap) -> FloatMap:
    """The share of a deflection at `depth` that displaces the image: ``(Z_b - Z_p) / Z_b``.

    1 before an infinitely far background, 0 on its surface, negative behind it.
    """
    return np.asarray(1 - depth * background_inverse_depth, np.float32)


def lever_gate(depth: FloatMap, background_inverse_depth: FloatMap) -> FloatMap:
    """Weight in [0, 1] of the evidence of a pixel at `depth`; 0 where refraction is invisible.

    A plume close before its background displaces nothing, and behind it is hidden; where the
    background is unknown (NaN) the weight is 0.
    """
    ramp = relative_lever(depth, background_inverse_depth)
    ramp -= np.float32(LEVER_NONE)
    ramp /= np.float32(LEVER_FULL - LEVER_NONE)
    return np.asarray(np.fmin(np.fmax(ramp, 0, out=ramp), 1, out=ramp))


@dataclass(frozen=True, kw_only=True)
class VoxelBox:
    """An axis-aligned volume of cubic voxels.

    Attributes:
        low_in_world: (3,) its lowest corner, world units.
        voxel: Edge of a voxel, world units.
        shape: Number of voxels along z, y, x.
    """

    low_in_world: FloatArray
    voxel: float
    shape: tuple[int, int, int]

    @classmethod
    def from_corners(cls, low: FloatArray, high: FloatArray, *, longest: int) -> Self:
        """The box from `low` to `high` with `longest` voxels along its longest edge."""
        voxel = float((high - low).max() / longest)
        nx, ny, nz = (max(1, int(np.ceil(size / voxel))) for size in high - low)
        return cls(low_in_world=np.asarray(low, dtype=float), voxel=voxel, shape=(nz, ny, nx))

    def centers_in_world(self, indices_zyx: FloatArray) -> FloatArray:
        """(N, 3) world positions of the centres of (N, 3) voxel indices (z, y, x)."""
        return self.low_in_world + (indices_zyx[:, ::-1] + 0.5) * self.voxel

    def pixels_from_slices(self, trajectory: Trajectory, i: int) -> FloatArray:
        """(Z, 3, 3) homographies from (x index, y index, 1) of each slice to pixels of frame `i`.

        Their third rows give the depth along the optical axis, in world units.
        """
        projection = trajectory.camera.matrix @ trajectory.rotations[i]
        corner = self.low_in_world + 0.5 * self.voxel
        by_index = projection * self.voxel
        corner_px = projection @ corner + trajectory.camera.matrix @ trajectory.translations[i]
        homographies = np.repeat(by_index[None], self.shape[0], axis=0)
        homographies[:, :, 2] = corner_px + by_index[:, 2] * np.arange(self.shape[0])[:, None]
        return homographies


@dataclass(frozen=True, kw_only=True)
class EvidenceGrid:
    """The sum over views.

    Attributes:
        box: Where the voxels are.
        llr: (Z, Y, X) summed log-likelihood ratio, nats per observed pixel.
        weight: (Z, Y, X) number of views that could see refraction in the voxel.
    """

    box: VoxelBox
    llr: FloatMap
    weight: FloatMap


def sum_evidence(
    box: VoxelBox, trajectory: Trajectory, llr: FloatMap, inverse_depth: FloatMap
) -> EvidenceGrid:
    """Sums the maps of all views into the voxels that they can see.

    Args:
        box: The volume.
        trajectory: Poses of the V views; its camera is a pinhole of the maps' size.
        llr: (V, H, W) evidence.
        inverse_depth: (V, H, W) of the background, 1 / world unit; NaN where unknown.
    """
    total = np.zeros(box.shape, np.float32)
    weight = np.zeros(box.shape, np.float32)
    background = np.empty(box.shape, np.float32)
    rows, columns = (np.arange(count, dtype=np.float32) for count in box.shape[1:])
    size = box.shape[:0:-1]
    flags = cv2.WARP_INVERSE_MAP
    for i in range(len(trajectory)):
        homographies = box.pixels_from_slices(trajectory, i)
        by_column, by_row, _ = homographies[0, 2]
        plane = by_column * columns + by_row * rows[:, None]
        depth = (plane + homographies[:, 2, 2, None, None]).astype(np.float32)
        for homography, layer in zip(homographies, background, strict=True):
            cv2.warpPerspective(
                inverse_depth[i],
                homography,
                size,
                dst=layer,
                flags=flags | cv2.INTER_NEAREST,
                borderValue=np.nan,
            )
        gate = lever_gate(depth, background)
        gate *= depth > 0
        for k in np.flatnonzero(gate.any(axis=(1, 2))):
            seen = cv2.warpPerspective(
                llr[i], homographies[k], size, flags=flags | cv2.INTER_LINEAR
            )
            seen *= gate[k]
            total[k] += seen
        weight += gate
    return EvidenceGrid(box=box, llr=total, weight=weight)
