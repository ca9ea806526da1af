"""Point clouds as binary PLY, in colour."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from geometry.arrays import FloatArray
from locate.export.pictures import heat_rgb

POSITION, COLOUR = ("x", "y", "z"), ("red", "green", "blue")


def write_plumes_ply(
    path: Path,
    *,
    points_in_world: FloatArray,
    probability: FloatArray,
    displacement_px: FloatArray,
) -> None:
    """Writes evidence voxels with the vertex attributes ``probability`` and ``displacement``.

    ``probability`` is the logistic of a voxel's mean evidence per view: 0.5 is no evidence, and it
    is not the probability that the voxel holds refracting air. It is what the colours show.

    Args:
        path: The file.
        points_in_world: (N, 3) voxel centres in world units; N may be 0.
        probability: (N,) logistic of the mean evidence per view.
        displacement_px: (N,) mean displacement of its plume, px: one constant per plume.

    Raises:
        ValueError: The arrays differ in length.
        OSError: The file could not be written.
    """
    _write_points(
        path,
        points_in_world,
        heat_rgb(probability),
        probability=probability,
        displacement=displacement_px,
    )


def write_scene_ply(
    path: Path,
    *,
    points_in_world: FloatArray,
    colours: NDArray[np.uint8],
    voxels_in_world: FloatArray,
    voxel_probability: FloatArray,
) -> None:
    """Writes the sparse points of a scene and the voxels of its plumes as one cloud.

    Args:
        path: The file.
        points_in_world: (N, 3) sparse points in world units; N may be 0.
        colours: (N, 3) red, green, blue of each.
        voxels_in_world: (V, 3) voxel centres; V may be 0.
        voxel_probability: (V,) logistic of their mean evidence per view, shown as colours.

    Raises:
        ValueError: The arrays differ in length.
        OSError: The file could not be written.
    """
    _write_points(
        path,
        np.concatenate([points_in_world, voxels_in_world]),
        np.concatenate([colours, heat_rgb(voxel_probability)]),
    )


def _write_points(
    path: Path, points: FloatArray, colours: NDArray[np.uint8], **attributes: FloatArray
) -> None:
    floats = [(name, "<f4") for name in (*POSITION, *attributes)]
    vertices = np.empty(len(points), [*floats, *((name, "u1") for name in COLOUR)])
    columns = {
        **dict(zip(POSITION, points.T, strict=True)),
        **attributes,
        **dict(zip(COLOUR, colours.T, strict=True)),
    }
    for name, column in columns.items():
        if column.shape != vertices.shape:
            raise ValueError(f"{name}: {column.shape=}, expected {vertices.shape}")
        vertices[name] = column
    header = [
        "ply\nformat binary_little_endian 1.0",
        f"element vertex {len(points)}",
        *(f"property float {name}" for name, _ in floats),
        *(f"property uchar {name}" for name in COLOUR),
        "end_header\n",
    ]
    path.write_bytes("\n".join(header).encode("ascii") + vertices.tobytes())
