"""The voxels of the plumes as a binary PLY point cloud."""

from pathlib import Path

import numpy as np

from geometry.arrays import FloatArray
from geometry.open3d_loader import load_open3d


def write_plumes_ply(
    path: Path,
    *,
    points_in_world: FloatArray,
    probability: FloatArray,
    displacement_px: FloatArray,
) -> None:
    """Writes evidence voxels with the vertex attributes ``probability`` and ``displacement``.

    Args:
        path: The file, ending in ``.ply``.
        points_in_world: (N, 3) voxel centres in world units; N may be 0.
        probability: (N,) that the voxel holds refracting air.
        displacement_px: (N,) displacement it takes part in, px.

    Raises:
        ValueError: The arrays differ in length.
        OSError: The file could not be written.
    """
    n = len(points_in_world)
    if probability.shape != (n,) or displacement_px.shape != (n,):
        raise ValueError(
            f"{probability.shape=}, {displacement_px.shape=}, expected ({n},) for {n} points"
        )
    if n == 0:
        path.write_bytes(_EMPTY)
        return
    o3d = load_open3d()
    cloud = o3d.t.geometry.PointCloud(np.ascontiguousarray(points_in_world, dtype=np.float32))
    # A 1-D attribute makes open3d return False without an error: columns it must be.
    cloud.point["probability"] = probability.astype(np.float32)[:, None]
    cloud.point["displacement"] = displacement_px.astype(np.float32)[:, None]
    if not o3d.t.io.write_point_cloud(str(path), cloud, write_ascii=False):
        raise OSError(f"{path}: open3d could not write the point cloud")


_EMPTY = b"""ply
format binary_little_endian 1.0
element vertex 0
property float x
property float y
property float z
property float probability
property float displacement
end_header
"""
