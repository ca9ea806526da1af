"""The files of a survey, each opened by a reader that this project did not write."""

import json
import re
import sqlite3
from datetime import UTC, datetime
from html import escape
from html.parser import HTMLParser
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest

from geometry.errors import BadInputError
from locate.survey.build import build_survey
from locate.survey.model import FlightMoment, Survey, SurveySettings
from locate.survey.page import write_map_page
from tests.locate.survey_runs import FIELD, Flown, write_run

SITES = np.array([[7.5, 12.5, 0.0], [-7.5, -17.5, 0.0]])  # in the middle of a cell
CELL_M = 5.0


@pytest.fixture(scope="module")
def done(tmp_path_factory: pytest.TempPathFactory) -> tuple[Survey, Path]:
    """Without any error: what is written must be where it stood."""
    root = tmp_path_factory.mktemp("files")
    morning, evening = datetime(2026, 7, 1, 10), datetime(2026, 1, 20, 19)
    flights = [
        Flown(name="morning", start=morning, feet=SITES, take_off=(0.0, 0.0)),
        Flown(name="evening", start=evening, feet=SITES[:1]),
    ]
    runs = [write_run(root, flown) for flown in flights]
    settings = SurveySettings(cell_m=CELL_M, wander_m=0.2)
    return build_survey(runs, root / "out", settings=settings), root / "out"


def lon_lat(points: np.ndarray) -> np.ndarray:
    return FIELD.lat_lon_height(points)[:, [1, 0]]


def gdal(path: Path, layer: str) -> tuple[dict[str, Any], list[Any], dict[str, Any]]:
    pyogrio = pytest.importorskip("pyogrio.raw")
    meta, _, geometry, fields = pyogrio.read(path, layer=layer)
    shapes = [] if geometry is None else list(geometry)
    return meta, shapes, dict(zip(meta["fields"], fields, strict=True))


def test_gdal_reads_every_layer(done: tuple[Survey, Path]) -> None:
    _, output = done
    path = output / "survey.gpkg"
    _, points, fields = gdal(path, "hotspots")
    places = np.array([np.frombuffer(point[5:], "<f8")[:2] for point in points])
    np.testing.assert_allclose(places, lon_lat(SITES), atol=2e-6)
    assert fields["seen"].tolist() == [2.0, 1.0]
    _, sightings, fields = gdal(path, "sightings")
    assert len(sightings) == 3
    assert sorted(fields["flight"]) == ["evening", "morning", "morning"]
    meta, paths, fields = gdal(path, "flights")
    assert meta["geometry_type"] == "LineString"
    assert len(paths) == 2
    assert fields["hour"].tolist() == pytest.approx([10, 19], abs=0.01)
    assert fields["date"].astype(str).tolist() == ["2026-07-01", "2026-01-20"]
    meta, cells, fields = gdal(path, "cells")
    assert meta["geometry_type"] == "Polygon"
    assert len(cells) == len(fields["probability"]) > 50
    assert (fields["seen"] <= fields["looked"]).all()
    assert np.nanmax(fields["probability_summer_09_12_h"]) > 0.5
    assert fields["seen"].sum() == pytest.approx(3.0, abs=1e-6)
    with sqlite3.connect(path) as file:
        assert file.execute("PRAGMA integrity_check").fetchone() == ("ok",)
        assert file.execute("PRAGMA foreign_key_check").fetchall() == []
    file.close()


def test_styles_are_in_the_table_of_qgis(done: tuple[Survey, Path]) -> None:
    _, output = done
    meta, _, fields = gdal(output / "survey.gpkg", "layer_styles")
    assert meta["geometry_type"] is None
    assert fields["f_table_name"].tolist() == ["hotspots", "sightings", "cells", "flights"]
    assert set(fields["f_geometry_column"]) == {"geom"}
    assert fields["useAsDefault"].astype(bool).all()
    styles = dict(zip(fields["f_table_name"], fields["styleQML"], strict=True))
    for layer, qml in styles.items():
        renderer = ElementTree.fromstring(qml).find("renderer-v2")
        assert renderer is not None
        symbols = renderer.findall("symbols/symbol")
        meta, _, values = gdal(output / "survey.gpkg", layer)
        kind = {"Point Z": "marker", "LineString": "line", "Polygon": "fill"}
        assert {symbol.get("type") for symbol in symbols} == {kind[meta["geometry_type"]]}
        if layer == "cells":
            field, ranges = renderer.get("attr"), renderer.findall("ranges/range")
            assert [part.get("symbol") for part in ranges] == [s.get("name") for s in symbols]
            highest = np.nanmax(values[field])
            assert float(ranges[-1].get("upper", "nan")) == pytest.approx(highest)


def test_the_raster_names_its_reference_system(done: tuple[Survey, Path]) -> None:
    rasterio = pytest.importorskip("rasterio")
    tifffile = pytest.importorskip("tifffile")
    _, output = done
    name = "WGS 84 / Transverse Mercator about 47.000000, 8.000000"
    with rasterio.open(output / "updraft.tif") as file:
        assert file.crs.to_wkt().startswith(f'PROJCS["{name}",GEOGCS["WGS 84",')
    with tifffile.TiffFile(output / "updraft.tif") as file:
        keys = file.geotiff_metadata
    assert keys["GTCitationGeoKey"] == name
    assert keys["GeographicTypeGeoKey"] == 4326


def test_tifffile_and_pyproj_find_the_hotspot_in_the_raster(done: tuple[Survey, Path]) -> None:
    pytest.importorskip("rasterio")
    tifffile = pytest.importorskip("tifffile")
    _, output = done
    with tifffile.TiffFile(output / "updraft.tif") as file:
        keys = file.geotiff_metadata
        bands = file.asarray()
        metadata = file.pages[0].tags["GDAL_METADATA"].value
    names = re.findall(r'sample="\d" role="description">(.*?)<', metadata)
    if bands.shape[-1] == len(names):
        bands = np.moveaxis(bands, -1, 0)
    assert names[0] == "updraft probability"
    assert names[-2:] == [
        "updraft probability, winter, 18-21 h", "updraft probability, summer, 09-12 h",
    ]  # fmt: skip
    east, north = in_the_projection(keys, lon_lat(SITES))
    west, top = keys["ModelTiepoint"][3:5]
    column = np.floor((east - west) / keys["ModelPixelScale"][0]).astype(int)
    row = np.floor((top - north) / keys["ModelPixelScale"][1]).astype(int)
    assert keys["ModelPixelScale"][0] == CELL_M
    seen = bands[names.index("flights that saw")]
    assert seen[row, column].tolist() == pytest.approx([2.0, 1.0], abs=0.6)
    probability = bands[0]
    assert np.isnan(probability).any(), "what was not covered has no probability"
    highest = np.unravel_index(np.nanargmax(probability), probability.shape)
    assert highest == (row[0], column[0])
    assert np.nanmin(probability) < 0.05
    assert (np.isnan(bands[-2]) == np.isnan(bands[0])).all()


def in_the_projection(keys: dict[str, Any], places: np.ndarray) -> np.ndarray:
    """East and north of (N, 2) lon, lat by the file's own keys."""
    pyproj = pytest.importorskip("pyproj")
    assert keys["ProjCoordTransGeoKey"] == 1
    projection = pyproj.Proj(
        proj="tmerc",
        lat_0=keys["ProjNatOriginLatGeoKey"],
        lon_0=keys["ProjNatOriginLongGeoKey"],
        k=keys["ProjScaleAtNatOriginGeoKey"],
        ellps="WGS84",
    )
    return np.array(projection(*places.T))


def test_aerofiles_and_gpxpy_read_the_hotspots(done: tuple[Survey, Path]) -> None:
    seeyou, gpxpy = pytest.importorskip("aerofiles.seeyou"), pytest.importorskip("gpxpy")
    _, output = done
    with (output / "hotspots.cup").open(encoding="utf-8") as file:
        waypoints = seeyou.Reader().read(file)["waypoints"]
    assert [waypoint["name"] for waypoint in waypoints] == ["Hotspot 1", "Hotspot 2"]
    assert "Seen by 2 of 2 flights" in waypoints[0]["description"]
    places = [(point["longitude"], point["latitude"]) for point in waypoints]
    np.testing.assert_allclose(places, lon_lat(SITES), atol=2e-5)
    points = gpxpy.parse((output / "hotspots.gpx").read_text()).waypoints
    places = [(point.longitude, point.latitude) for point in points]
    np.testing.assert_allclose(places, lon_lat(SITES), atol=2e-6)


def test_the_geojson_has_a_point_and_an_ellipse_each(done: tuple[Survey, Path]) -> None:
    _, output = done
    features = json.loads((output / "hotspots.geojson").read_text())["features"]
    assert [f["geometry"]["type"] for f in features] == ["Point"] * 2 + ["Polygon"] * 2
    assert features[0]["properties"]["looked"] == 2


class Page(HTMLParser):
    """Addresses the page would load, pictures it draws, and whether every tag is closed."""

    VOID = ("meta", "link", "img", "input", "br")

    def __init__(self) -> None:
        super().__init__()
        self.addresses: list[str] = []
        self.pictures = 0
        self.open: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        if tag not in self.VOID:
            self.open.append(tag)
        self.pictures += tag == "image"
        links = [value or "" for name, value in attrs if name in ("src", "href", "xlink:href")]
        self.addresses += [link for link in links if not link.startswith("data:")]

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.handle_starttag(tag, attrs)
        self.handle_endtag(tag)


def test_the_page_needs_no_network(done: tuple[Survey, Path]) -> None:
    _, output = done
    text = (output / "map.html").read_text()
    page = Page()
    page.feed(text)
    assert page.open == []
    assert page.addresses == []
    assert page.pictures == 4, "all flights, two bins, and the covering flights"
    assert "2 hotspots from 2 flights" in text
    assert "http" not in text.replace("http-equiv", "")
    assert len(text) < 200_000


def test_without_the_extra_there_is_no_raster_and_all_else(
    done: tuple[Survey, Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    run = write_run(tmp_path, Flown(name="alone", feet=SITES))
    monkeypatch.setitem(__import__("sys").modules, "rasterio", None)
    without = build_survey([run], tmp_path / "out")
    names = {path.name for path in (tmp_path / "out").iterdir()}
    assert "updraft.tif" not in names
    assert {"map.html", "survey.gpkg", "survey.json", "hotspots.cup"} <= names
    told = "updraft.tif was left out: pip install 'plume-locate[survey]', then map anew"
    assert told in without.notes
    assert escape(told) in (tmp_path / "out" / "map.html").read_text()


def test_the_page_has_dates_a_legend_and_the_datum(done: tuple[Survey, Path]) -> None:
    survey, output = done
    text = (output / "map.html").read_text()
    assert "2026-07-01 10:00" in text
    assert "2026-01-20 19:00" in text
    assert "day 1" not in text
    scales = re.findall(r'<p class="scale layer( shown)?" data-layer="(\w+)">', text)
    layers = re.findall(r'<image id="(\w+)" class="layer', text)
    assert [layer for _, layer in scales] == layers
    assert [shown for shown, _ in scales] == [" shown"] + [""] * (len(layers) - 1)
    assert "Height above mean sea level" in text
    unknown = survey.frame.to_dict() | {"height_datum": "unknown"}
    write_map_page(output / "unknown.html", survey.model_copy(update={"origin": unknown}), None)
    assert "Height above a datum that is not stated" in (output / "unknown.html").read_text()


@pytest.mark.parametrize("hour", [23.9, 0.1, 12.0])
def test_the_local_date_is_that_of_the_local_hour(hour: float) -> None:
    """By the Earth's turn the date is a day off where solar midnight lies between."""
    clock = datetime(2026, 1, 1, 11, 30, tzinfo=UTC)
    moment = FlightMoment(clock_s=clock.timestamp(), hour=hour, day_of_year=1, basis="UTC")
    assert abs((moment.local - clock.replace(tzinfo=None)).total_seconds()) <= 12.5 * 3600
    assert moment.local.hour == int(hour)


@pytest.mark.parametrize("name", ["../../victim", "a/b", "..", ""])
def test_a_flight_whose_name_is_a_path_is_refused(tmp_path, name):
    path = tmp_path / "survey.json"
    flight = {"name": name, "source": "x", "folder": "y", "digest": ""}
    path.write_text(json.dumps({"schema": "locate.survey/1", "flights": [flight]}))
    with pytest.raises(BadInputError, match=r"flights\.0\.name"):
        Survey.load(path)
