"""The voxels of the plumes as a binary PLY point cloud."""

from pathlib import Path
from types import ModuleType

import numpy as np

from geometry.arrays import FloatArray
from geometry.errors import LocateError
from geometry.open3d_loader import load_open3d


def write_plumes_ply(
    path: Path,
    *,
    points_in_world: FloatArray,
    probability: FloatArray,
    displacement_px: FloatArray,
) -> None:
    """Writes evidence voxels with the vertex attributes ``probability`` and ``displacement``.

    ``probability`` is the logistic of a voxel's mean evidence per view: 0.5 is no evidence, and it
    is not the probability that the voxel holds refracting air.

    Args:
        path: The file, ending in ``.ply``.
        points_in_world: (N, 3) voxel centres in world units; N may be 0.
        probability: (N,) logistic of the mean evidence per view.
        displacement_px: (N,) mean displacement of its plume, px: one constant per plume.

    Raises:
        ValueError: The arrays differ in length.
        OSError: The file could not be written.
    """
    n = len(points_in_world)
    if probability.shape != (n,) or displacement_px.shape != (n,):
        raise ValueError(
            f"{probability.shape=}, {displacement_px.shape=}, expected ({n},) for {n} points"
        )
    columns = np.column_stack([points_in_world, probability, displacement_px]).astype(np.float32)
    o3d = _try_open3d() if n else None
    if o3d is None:
        path.write_bytes(_HEADER.format(n).encode() + columns.astype("<f4").tobytes())
        return
    cloud = o3d.t.geometry.PointCloud(np.ascontiguousarray(columns[:, :3]))
    # A 1-D attribute makes open3d return False without an error: columns they must be.
    cloud.point["probability"] = columns[:, 3:4]
    cloud.point["displacement"] = columns[:, 4:5]
    if not o3d.t.io.write_point_cloud(str(path), cloud, write_ascii=False):
        raise OSError(f"{path}: open3d could not write the point cloud")


def _try_open3d() -> ModuleType | None:
    """open3d; None on a machine that lacks the graphics libraries it wants."""
    try:
        return load_open3d()
    except LocateError:
        return None


# For what open3d does not write: a cloud without points, and on a machine where it does not start.
_HEADER = """ply
format binary_little_endian 1.0
element vertex {}
property float x
property float y
property float z
property float probability
property float displacement
end_header
"""
