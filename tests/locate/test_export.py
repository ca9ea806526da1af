import json
from pathlib import Path

import numpy as np
import pytest

from geometry.errors import LocateError
from geometry.open3d_loader import load_open3d
from locate.export import ply
from locate.export.geojson import lon_lat_height, write_geojson
from locate.export.ply import write_plumes_ply
from tests.locate.answers import plume, plume_map

HELSINKI = {
    "origin_lat_deg": 60.17,
    "origin_lon_deg": 24.94,
    "origin_height_m": 12.5,
    "height_datum": "WGS84 ellipsoid",
}


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


def test_geojson_puts_east_north_up_on_the_earth(tmp_path: Path) -> None:
    source = np.array([100.0, -50.0, 2.0])
    path = tmp_path / "plumes.geojson"
    write_geojson(path, plume_map(plume(source), georeference=HELSINKI))
    feature = json.loads(path.read_text())["features"][0]
    lon, lat, height = feature["geometry"]["coordinates"]
    # Radii of curvature of the WGS84 ellipsoid, a derivation of its own.
    latitude, a, e2 = np.radians(HELSINKI["origin_lat_deg"]), 6378137.0, 0.00669437999014
    w = 1 - e2 * np.sin(latitude) ** 2
    prime_vertical, meridian = a / np.sqrt(w), a * (1 - e2) / w**1.5
    east = np.radians(lon - HELSINKI["origin_lon_deg"]) * prime_vertical * np.cos(latitude)
    north = np.radians(lat - HELSINKI["origin_lat_deg"]) * meridian
    np.testing.assert_allclose([east, north, height - 12.5], source, atol=0.01)
    assert feature["properties"]["height_datum"] == "WGS84 ellipsoid"
    assert feature["properties"]["sigma_up_m"] == pytest.approx(0.03, rel=0.1)


def test_the_origin_is_where_the_georeference_says() -> None:
    position = lon_lat_height(np.zeros((1, 3)), HELSINKI)[0]
    np.testing.assert_allclose(position, [24.94, 60.17, 12.5], rtol=1e-9)


def test_a_map_without_georeference_has_no_geojson(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="no georeference"):
        write_geojson(tmp_path / "plumes.geojson", plume_map(plume()))


def test_no_plume_is_an_empty_collection(tmp_path: Path) -> None:
    path = tmp_path / "plumes.geojson"
    write_geojson(path, plume_map(georeference=HELSINKI))
    assert json.loads(path.read_text()) == {"type": "FeatureCollection", "features": []}
