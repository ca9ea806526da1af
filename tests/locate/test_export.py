"""Point clouds, read by open3d, which did not write them."""

from pathlib import Path

import numpy as np
import pytest

from geometry.open3d_loader import load_open3d
from locate.export.pictures import heat_colours
from locate.export.ply import write_plumes_ply, write_scene_ply


def heat(probability: np.ndarray) -> np.ndarray:
    """(N, 3) red, green, blue."""
    return np.array([heat_colours(np.float32([[value]]))[0, 0, ::-1] for value in probability])


@pytest.mark.parametrize("count", [0, 1, 1000])
def test_open3d_reads_the_voxels_and_their_colours(tmp_path: Path, count: int) -> None:
    rng = np.random.default_rng(1)
    points, probability = rng.normal(size=(count, 3)), rng.uniform(size=count)
    displacement = rng.uniform(0, 2, size=count)
    path = tmp_path / "plumes.ply"
    write_plumes_ply(
        path, points_in_world=points, probability=probability, displacement_px=displacement
    )
    assert b"format binary_little_endian" in path.read_bytes()[:100]
    cloud = load_open3d().t.io.read_point_cloud(str(path))
    np.testing.assert_array_equal(cloud.point["positions"].numpy(), points.astype(np.float32))
    for name, values in (("probability", probability), ("displacement", displacement)):
        read = cloud.point[name].numpy()
        np.testing.assert_array_equal(read, values.astype(np.float32)[:, None])
    if count:
        np.testing.assert_array_equal(cloud.point["colors"].numpy(), heat(probability))


@pytest.mark.parametrize("voxels", [0, 4])
def test_open3d_reads_the_scene_and_its_colours(tmp_path: Path, voxels: int) -> None:
    rng = np.random.default_rng(2)
    points, colours = rng.normal(size=(50, 3)), rng.integers(0, 256, (50, 3), np.uint8)
    plume, probability = rng.normal(size=(voxels, 3)), rng.uniform(size=voxels)
    path = tmp_path / "scene.ply"
    write_scene_ply(
        path,
        points_in_world=points, colours=colours,
        voxels_in_world=plume, voxel_probability=probability,
    )  # fmt: skip
    cloud = load_open3d().io.read_point_cloud(str(path))
    np.testing.assert_allclose(np.asarray(cloud.points), [*points, *plume], rtol=1e-6)
    shown = np.rint(255 * np.asarray(cloud.colors))
    np.testing.assert_array_equal(shown, [*colours, *heat(probability)])


def test_a_cloud_that_cannot_be_written_is_an_error(tmp_path: Path) -> None:
    with pytest.raises(OSError, match="missing"):
        write_plumes_ply(
            tmp_path / "missing" / "plumes.ply",
            points_in_world=np.zeros((1, 3)),
            probability=np.zeros(1),
            displacement_px=np.zeros(1),
        )


def test_attributes_of_another_length_are_refused(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=r"expected \(2,\)"):
        write_plumes_ply(
            tmp_path / "plumes.ply",
            points_in_world=np.zeros((2, 3)),
            probability=np.zeros(2),
            displacement_px=np.zeros((2, 1)),
        )
