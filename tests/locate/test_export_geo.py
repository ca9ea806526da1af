"""The map on the Earth, each file opened by a reader that this project did not write."""

import json
import sqlite3
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from geometry.georeference import Alignment, Georeference, HeightDatum, fit_similarity
from geometry.pose_files import read_named_poses, write_colmap_model
from geometry.similarity import Similarity
from locate.export.geojson import write_geojson
from locate.export.geopackage import write_geopackage
from locate.export.kml import write_kml
from locate.export.las import utm_positions, write_las
from locate.export.located import plumes_on_earth
from locate.export.waypoints import write_cup, write_gpx
from locate.map.georeferenced import georeference_map
from locate.map.plume import PlumeMap
from tests.geometry.surveys import looking_down, strips, survey
from tests.locate.answers import plume, plume_map

ORIGIN = (60.17, 24.94, 12.5)
SOURCES = np.array([[100.0, -50.0, 2.0], [-30.0, 20.0, 5.0]])
DATUMS = [HeightDatum.ELLIPSOID, HeightDatum.EGM96, HeightDatum.MEAN_SEA_LEVEL]


def helsinki(datum: HeightDatum = HeightDatum.ELLIPSOID) -> Georeference:
    return Georeference.from_origin(ORIGIN, datum, "first fix")


def answer(datum: HeightDatum = HeightDatum.ELLIPSOID) -> PlumeMap:
    plumes = [plume(source, id=i + 1) for i, source in enumerate(SOURCES)]
    return plume_map(*plumes, georeference=helsinki(datum).to_dict(), notes=("One & <two>.",))


def lon_lat_height(datum: HeightDatum) -> np.ndarray:
    return helsinki(datum).lat_lon_height(SOURCES)[:, [1, 0, 2]]


def gdal(path: Path, layer: str | None = None) -> tuple[dict[str, Any], list[Any], dict[str, Any]]:
    """Metadata, shapes and fields of a layer, as GDAL sees them."""
    pyogrio = pytest.importorskip("pyogrio.raw")
    meta, _, geometry, fields = pyogrio.read(path, layer=layer)
    return meta, list(geometry), dict(zip(meta["fields"], fields, strict=True))


def point(wkb: bytes) -> np.ndarray:
    """The coordinates of a little-endian WKB point, with or without Z."""
    return np.frombuffer(wkb[5:], dtype="<f8")


@pytest.mark.parametrize("datum", DATUMS)
def test_geojson_keeps_to_the_standard(tmp_path: Path, datum: HeightDatum) -> None:
    path = tmp_path / "plumes.geojson"
    write_geojson(path, answer(datum))
    content = json.loads(path.read_text())
    assert set(content) == {"type", "features", "answer", "description"}
    points = [f for f in content["features"] if f["geometry"]["type"] == "Point"]
    expected = lon_lat_height(datum)
    for feature, place in zip(points, expected, strict=True):
        coordinates = feature["geometry"]["coordinates"]
        np.testing.assert_allclose(coordinates[:2], place[:2], atol=1e-9)
        assert feature["properties"]["height_m"] == pytest.approx(place[2])
        assert feature["properties"]["height_datum"] == str(datum)
    # RFC 7946, section 4: a third number is a height above the ellipsoid and nothing else.
    heights = {len(feature["geometry"]["coordinates"]) for feature in points}
    if datum is HeightDatum.ELLIPSOID:
        assert heights == {3}
    if datum is HeightDatum.MEAN_SEA_LEVEL:
        assert heights == {2}
    rings = [f["geometry"]["coordinates"][0] for f in content["features"][len(points) :]]
    assert len(rings) == 2
    for ring in rings:
        assert ring[0] == ring[-1]
        x, y = np.array(ring).T - np.array([[24.94], [60.17]])
        assert (x[:-1] * y[1:] - x[1:] * y[:-1]).sum() > 0, "the outer ring runs clockwise"


def test_gdal_reads_the_geojson(tmp_path: Path) -> None:
    path = tmp_path / "plumes.geojson"
    write_geojson(path, answer())
    meta, shapes, fields = gdal(path)
    assert meta["crs"] == "EPSG:4326"
    np.testing.assert_allclose(point(shapes[0]), lon_lat_height(HeightDatum.ELLIPSOID)[0])
    assert fields["sigma_up_m"][0] == pytest.approx(0.03, rel=0.1)


def test_the_ellipse_holds_the_horizontal_error_at_95_percent() -> None:
    one = plumes_on_earth(answer())[0]
    ring = helsinki().to_enu(
        np.column_stack([one.ellipse_lon_lat[:, ::-1], np.full(len(one.ellipse_lon_lat), 14.5)])
    )
    off = (ring - SOURCES[0])[:, :2]
    inverse = np.linalg.inv(one.plume.source_covariance[:2, :2])
    squared = np.einsum("ni,ij,nj->n", off, inverse, off)
    np.testing.assert_allclose(squared, 5.991, rtol=1e-3)


def test_an_ellipse_over_the_date_line_does_not_jump() -> None:
    at_180 = Georeference.from_origin([-17.0, 179.99999995, 0.0], HeightDatum.ELLIPSOID, "Fiji")
    wide = plume(np.zeros(3), source_covariance=np.eye(3))
    ring = plumes_on_earth(plume_map(wide, georeference=at_180.to_dict()))[0].ellipse_lon_lat
    assert np.ptp(ring[:, 0]) < 1e-3


@pytest.mark.parametrize("datum", DATUMS)
def test_kml_passes_the_ogc_schema(tmp_path: Path, datum: HeightDatum) -> None:
    path = tmp_path / "plumes.kml"
    write_kml(path, answer(datum))
    validator = pytest.importorskip("fastkml.validator")
    assert validator.validate(file_to_validate=path)
    kml = pytest.importorskip("fastkml.kml").KML.parse(path)
    marks = [mark for mark in kml.features[0].features if mark.name in ("Plume 1", "Plume 2")]
    expected = lon_lat_height(datum)
    for mark, place in zip(marks, expected, strict=True):
        np.testing.assert_allclose(mark.geometry.coords[0][:2], place[:2], atol=1e-8)
        mode = mark.kml_geometry.altitude_mode.value
        if datum.is_sea_level:
            assert mode == "absolute"
            assert mark.geometry.coords[0][2] == pytest.approx(place[2], abs=1e-3)
        elif mode != "absolute":
            assert mode == "clampToGround"
            assert not mark.geometry.has_z
        data = {item.name: item.value for item in mark.extended_data.elements}
        assert data["height_datum"] == str(datum)


def test_gdal_reads_the_kml(tmp_path: Path) -> None:
    path = tmp_path / "plumes.kml"
    write_kml(path, answer(HeightDatum.EGM96))
    _, shapes, fields = gdal(path)
    assert list(fields["Name"])[:1] == ["Plume 1"]
    np.testing.assert_allclose(point(shapes[0]), lon_lat_height(HeightDatum.EGM96)[0], atol=1e-3)


@pytest.mark.parametrize(
    ("datum", "crs"),
    [
        (HeightDatum.ELLIPSOID, "EPSG:4979"),
        (HeightDatum.EGM96, "EPSG:9707"),
        (HeightDatum.MEAN_SEA_LEVEL, "EPSG:4326"),
    ],
)
def test_gdal_reads_the_geopackage(tmp_path: Path, datum: HeightDatum, crs: str) -> None:
    path = tmp_path / "plumes.gpkg"
    write_geopackage(path, answer(datum))
    write_geopackage(path, answer(datum))
    meta, shapes, fields = gdal(path, "plumes")
    assert meta["crs"] == crs
    assert "Z" in meta["geometry_type"] or "2.5D" in meta["geometry_type"]
    np.testing.assert_allclose([point(s) for s in shapes], lon_lat_height(datum), rtol=1e-12)
    assert fields["probability"].tolist() == [0.9999, 0.9999]
    assert set(fields["height_datum"]) == {str(datum)}
    ring_meta, rings, ring_fields = gdal(path, "plume_uncertainty")
    assert ring_meta["geometry_type"] == "Polygon"
    assert len(rings) == 2
    assert ring_fields["plume"].tolist() == [1, 2]


def test_the_geopackage_is_what_the_standard_asks_for(tmp_path: Path) -> None:
    path = tmp_path / "plumes.gpkg"
    write_geopackage(path, answer())
    with sqlite3.connect(path) as file:
        assert file.execute("PRAGMA application_id").fetchone() == (0x47504B47,)
        assert file.execute("PRAGMA integrity_check").fetchone() == ("ok",)
        assert file.execute("PRAGMA foreign_key_check").fetchall() == []
        systems = {row[0] for row in file.execute("SELECT srs_id FROM gpkg_spatial_ref_sys")}
    file.close()
    assert {-1, 0, 4326} <= systems


@pytest.mark.parametrize("datum", DATUMS)
def test_gpxpy_reads_the_waypoints(tmp_path: Path, datum: HeightDatum) -> None:
    gpxpy = pytest.importorskip("gpxpy")
    path = tmp_path / "plumes.gpx"
    write_gpx(path, answer(datum))
    waypoints = gpxpy.parse(path.read_text()).waypoints
    assert [w.name for w in waypoints] == ["Plume 1", "Plume 2"]
    for waypoint, place in zip(waypoints, lon_lat_height(datum), strict=True):
        assert [waypoint.longitude, waypoint.latitude] == pytest.approx(place[:2], abs=1e-8)
        if datum.is_sea_level:
            assert waypoint.elevation == pytest.approx(place[2], abs=1e-3)
        assert str(datum) in waypoint.description


@pytest.mark.parametrize("origin", [ORIGIN, (-33.99999999, -0.00000001, 100.0)])
def test_aerofiles_reads_the_soaring_waypoints(
    tmp_path: Path, origin: tuple[float, float, float]
) -> None:
    seeyou = pytest.importorskip("aerofiles.seeyou")
    frame = Georeference.from_origin(origin, HeightDatum.EGM96, "field")
    one = plume_map(plume(np.zeros(3)), georeference=frame.to_dict())
    path = tmp_path / "plumes.cup"
    write_cup(path, one)
    with path.open(encoding="utf-8") as file:
        (waypoint,) = seeyou.Reader().read(file)["waypoints"]
    assert waypoint["name"] == "Plume 1"
    assert waypoint["latitude"] == pytest.approx(origin[0], abs=1e-5)
    assert waypoint["longitude"] == pytest.approx(origin[1], abs=1e-5)
    assert waypoint["elevation"] == {"value": pytest.approx(origin[2], abs=0.1), "unit": "m"}


def test_a_waypoint_without_a_known_sea_height_has_none(tmp_path: Path) -> None:
    seeyou = pytest.importorskip("aerofiles.seeyou")
    above_takeoff = answer(HeightDatum.TAKEOFF)
    write_cup(tmp_path / "plumes.cup", above_takeoff)
    with (tmp_path / "plumes.cup").open(encoding="utf-8") as file:
        waypoints = seeyou.Reader().read(file)["waypoints"]
    assert [w["elevation"]["value"] for w in waypoints] == [None, None]
    assert "above take-off" in waypoints[0]["description"]
    gpxpy = pytest.importorskip("gpxpy")
    write_gpx(tmp_path / "plumes.gpx", above_takeoff)
    assert gpxpy.parse((tmp_path / "plumes.gpx").read_text()).waypoints[0].elevation is None


@pytest.mark.parametrize("suffix", ["las", "laz"])
@pytest.mark.parametrize(
    ("datum", "vertical"), [(HeightDatum.ELLIPSOID, None), (HeightDatum.EGM96, "EGM96 height")]
)
def test_laspy_reads_the_cloud(
    tmp_path: Path, suffix: str, datum: HeightDatum, vertical: str | None
) -> None:
    laspy = pytest.importorskip("laspy")
    path = tmp_path / f"points.{suffix}"
    points = np.random.default_rng(1).uniform(-200, 200, size=(500, 3))
    probability = np.linspace(0, 1, 500)
    write_las(path, helsinki(datum), points, {"probability": probability})
    cloud = laspy.read(path)
    system = cloud.header.parse_crs()
    horizontal = system.sub_crs_list[0] if system.is_compound else system
    assert horizontal.to_epsg() == 32635
    assert vertical is None or system.sub_crs_list[1].name == vertical
    np.testing.assert_allclose(cloud.xyz, utm_positions(helsinki(datum), points), atol=6e-4)
    np.testing.assert_allclose(cloud["probability"], probability, atol=1e-6)
    assert any(str(datum) in str(vlr.record_data_bytes()) for vlr in cloud.vlrs)


def test_utm_is_a_map_projection_of_the_right_place() -> None:
    """On the central meridian the scale is 0.9996 and grid north is true north."""
    frame = Georeference.from_origin([0.0, 27.0, 0.0], HeightDatum.ELLIPSOID, "equator")
    east, north, up = utm_positions(frame, np.array([[0.0, 0.0, 0.0], [100.0, 0.0, 0.0]])).T
    assert [east[0], north[0], up[0]] == pytest.approx([500_000, 0, 0], abs=1e-6)
    assert east[1] - east[0] == pytest.approx(99.96, abs=1e-3)


def test_an_empty_map_makes_empty_files_that_open(tmp_path: Path) -> None:
    empty = plume_map(georeference=helsinki().to_dict())
    write_geojson(tmp_path / "e.geojson", empty)
    write_kml(tmp_path / "e.kml", empty)
    write_geopackage(tmp_path / "e.gpkg", empty)
    write_cup(tmp_path / "e.cup", empty)
    write_gpx(tmp_path / "e.gpx", empty)
    write_las(tmp_path / "e.las", helsinki(), np.zeros((0, 3)))
    collection = json.loads((tmp_path / "e.geojson").read_text())
    assert collection["features"] == []
    assert collection["answer"] == "none_found"
    for text in (collection["description"], (tmp_path / "e.kml").read_text()):
        assert "a plume of 0.25 px would have been seen" in text
    assert pytest.importorskip("fastkml.validator").validate(file_to_validate=tmp_path / "e.kml")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        assert gdal(tmp_path / "e.gpkg", "plumes")[1] == []
    assert len(pytest.importorskip("laspy").read(tmp_path / "e.las").points) == 0


@pytest.mark.parametrize(
    "write", [write_geojson, write_kml, write_geopackage, write_cup, write_gpx]
)
def test_a_map_without_georeference_has_no_place(tmp_path: Path, write: Any) -> None:
    with pytest.raises(ValueError, match="no georeference"):
        write(tmp_path / "plumes", plume_map(plume()))


def aligned() -> Alignment:
    return fit_similarity([survey(strips(30), np.random.default_rng(3)).fixes])


def test_a_georeferenced_map_carries_the_uncertainty_of_its_frame(tmp_path: Path) -> None:
    alignment = aligned()
    before = plume_map(plume(SOURCES[0]))
    after = georeference_map(before, alignment, helsinki())
    added = after.plumes[0].source_covariance - before.plumes[0].source_covariance
    np.testing.assert_allclose(added, alignment.position_covariances(SOURCES[:1])[0])
    assert after.plumes[0].axis_sigma_rad > before.plumes[0].axis_sigma_rad
    after.save(tmp_path / "map.json")
    block = PlumeMap.load(tmp_path / "map.json").georeference
    assert block is not None
    assert block["origin_name"] == "first fix"
    np.testing.assert_allclose(block["covariance"], alignment.covariance)
    assert block["sources"][0]["name"] == "GPS"
    assert Georeference.from_dict(block) == helsinki()


def test_a_colmap_model_of_the_georeferenced_run_holds_metres(tmp_path: Path) -> None:
    path = strips(8)
    scene_from_enu = Similarity(scale=0.2, rotation=np.eye(3), translation=np.ones(3))
    scene = looking_down(path).transformed(scene_from_enu)
    write_colmap_model(scene.transformed(scene_from_enu.inverse()), SOURCES, tmp_path / "model")
    read = read_named_poses(tmp_path / "model").trajectory
    np.testing.assert_allclose(read.centers_in_world, path, atol=1e-9)
