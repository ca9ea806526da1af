from pathlib import Path

import numpy as np
import pytest

from geometry.errors import LocateError
from geometry.open3d_loader import load_open3d
from locate.export import ply
from locate.export.ply import write_plumes_ply


@pytest.fixture(params=["open3d", "no open3d"])
def writer(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    """Both ways of writing: with open3d, and on a machine where it does not start."""

    def refuse() -> None:
        raise LocateError("open3d does not start")

    if request.param == "no open3d":
        monkeypatch.setattr(ply, "load_open3d", refuse)


@pytest.mark.usefixtures("writer")
@pytest.mark.parametrize("count", [0, 1, 1000])
def test_open3d_reads_the_voxels_back(tmp_path: Path, count: int) -> None:
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


def test_a_cloud_that_cannot_be_written_is_an_error(tmp_path: Path) -> None:
    with pytest.raises(OSError, match="could not write"):
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
