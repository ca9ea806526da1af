"""The sources as a GeoPackage, OGC 12-128r18 (version 1.3): one SQLite file for any GIS."""

import sqlite3
import struct
from collections.abc import Iterator, Sequence
from contextlib import closing, contextmanager
from datetime import date
from pathlib import Path
from typing import Any

import numpy as np

from geometry.arrays import FloatArray
from geometry.georeference import HeightDatum
from locate.export.layer_styles import add_styles, marker, outline, single
from locate.export.located import CONFIDENCE, georeference_of, plumes_on_earth
from locate.export.report.layout import PLUME_COLORS
from locate.map.plume import PlumeMap

APPLICATION_ID = 0x47504B47
USER_VERSION = 10300
WGS84_2D = 4326
POINT_Z, LINE, POLYGON = 1001, 2, 3
SQL_TYPES = {bool: "BOOLEAN", int: "INTEGER", float: "REAL", str: "TEXT", date: "DATE"}

TABLES = """
CREATE TABLE gpkg_spatial_ref_sys (
  srs_name TEXT NOT NULL, srs_id INTEGER NOT NULL PRIMARY KEY, organization TEXT NOT NULL,
  organization_coordsys_id INTEGER NOT NULL, definition TEXT NOT NULL, description TEXT);
CREATE TABLE gpkg_contents (
  table_name TEXT NOT NULL PRIMARY KEY, data_type TEXT NOT NULL, identifier TEXT UNIQUE,
  description TEXT DEFAULT '',
  last_change DATETIME NOT NULL DEFAULT (strftime('%Y-%m-%dT%H:%M:%fZ','now')),
  min_x DOUBLE, min_y DOUBLE, max_x DOUBLE, max_y DOUBLE, srs_id INTEGER,
  CONSTRAINT fk_gc_r_srs_id FOREIGN KEY (srs_id) REFERENCES gpkg_spatial_ref_sys(srs_id));
CREATE TABLE gpkg_geometry_columns (
  table_name TEXT NOT NULL, column_name TEXT NOT NULL, geometry_type_name TEXT NOT NULL,
  srs_id INTEGER NOT NULL, z TINYINT NOT NULL, m TINYINT NOT NULL,
  CONSTRAINT pk_geom_cols PRIMARY KEY (table_name, column_name),
  CONSTRAINT uk_gc_table_name UNIQUE (table_name),
  CONSTRAINT fk_gc_tn FOREIGN KEY (table_name) REFERENCES gpkg_contents(table_name),
  CONSTRAINT fk_gc_srs FOREIGN KEY (srs_id) REFERENCES gpkg_spatial_ref_sys (srs_id));
"""
UNDEFINED = (
    ("Undefined Cartesian SRS", -1, "NONE", -1, "undefined", "undefined Cartesian coordinates"),
    ("Undefined geographic SRS", 0, "NONE", 0, "undefined", "undefined geographic coordinates"),
)
"""The two rows that the standard wants in every file, beside WGS84."""


def write_geopackage(path: Path, plume_map: PlumeMap) -> None:
    """Writes the layers ``plumes`` (3D points) and ``plume_uncertainty`` (95 % ellipses), styled.

    The heights of the points are in the datum of the map: their reference system is EPSG:4979 for
    the ellipsoid, EPSG:9707 or 9518 for a named geoid, and else two-dimensional WGS84, where the
    column ``height_datum`` alone states what they count from.

    Raises:
        ValueError: The map is not georeferenced.
    """
    plumes = plumes_on_earth(plume_map)
    with new_geopackage(path) as file:
        points_srs = add_reference_systems(file, georeference_of(plume_map).datum)
        positions = np.reshape([(p.lon_deg, p.lat_deg, p.height_m) for p in plumes], (-1, 3))
        add_layer(
            file,
            "plumes",
            ("POINT", points_srs, 1),
            [p.properties() for p in plumes],
            [point_blob(points_srs, place) for place in positions],
            positions[:, :2],
        )
        rings = [p.ellipse_lon_lat for p in plumes]
        add_layer(
            file,
            "plume_uncertainty",
            ("POLYGON", WGS84_2D, 0),
            [{"plume": p.plume.id, "confidence": CONFIDENCE} for p in plumes],
            [polygon_blob(ring) for ring in rings],
            np.concatenate([np.zeros((0, 2)), *rings]),
        )
        add_styles(
            file,
            {
                "plumes": single(marker(PLUME_COLORS[0], 3.0), label="plume"),
                "plume_uncertainty": single(outline(PLUME_COLORS[0], 0.5)),
            },
        )


@contextmanager
def new_geopackage(path: Path) -> Iterator[sqlite3.Connection]:
    """Yields an empty file in place of an older one at `path`; written if nothing was raised."""
    path.unlink(missing_ok=True)
    with closing(sqlite3.connect(path)) as file, file:
        file.execute(f"PRAGMA application_id = {APPLICATION_ID}")
        file.execute(f"PRAGMA user_version = {USER_VERSION}")
        file.executescript(TABLES)
        file.executemany("INSERT INTO gpkg_spatial_ref_sys VALUES (?,?,?,?,?,?)", UNDEFINED)
        yield file


def add_reference_systems(file: sqlite3.Connection, datum: HeightDatum) -> int:
    """WGS84, and the three-dimensional system of the heights; returns the id of the latter."""
    from pyproj import CRS

    codes = [WGS84_2D, int(datum.epsg_code.removeprefix("EPSG:")) if datum.epsg_code else WGS84_2D]
    for code in sorted(set(codes)):
        system = CRS.from_epsg(code)
        # WKT1 has no three-dimensional geographic systems.
        wkt = system.to_wkt("WKT1_GDAL" if code == WGS84_2D else "WKT2_2019")
        file.execute(
            "INSERT INTO gpkg_spatial_ref_sys VALUES (?,?,?,?,?,?)",
            (system.name, code, "EPSG", code, wkt, None),
        )
    return codes[1]


def add_layer(
    file: sqlite3.Connection,
    table: str,
    geometry: tuple[str, int, int],
    rows: Sequence[dict[str, Any]],
    blobs: Sequence[bytes],
    corners_lon_lat: FloatArray,
) -> None:
    """Adds a table of features.

    Args:
        file: From `new_geopackage`.
        table: Its name.
        geometry: Kind of geometry, id of its reference system, 1 if it has heights or 0.
        rows: The fields of each feature, all with the same names; None and NaN become NULL.
        blobs: The geometry of each.
        corners_lon_lat: (N, 2) of all of them, for the extent.
    """
    kind, srs, z = geometry
    columns = {name: _sql_type([row[name] for row in rows]) for name in (rows[0] if rows else ())}
    typed = "".join(f', "{name}" {sql}' for name, sql in columns.items())
    file.execute(
        f'CREATE TABLE "{table}" (fid INTEGER PRIMARY KEY AUTOINCREMENT NOT NULL, '
        f"geom {kind}{typed})"
    )
    low, high = [None, None], [None, None]
    if len(corners_lon_lat):
        low, high = corners_lon_lat.min(axis=0).tolist(), corners_lon_lat.max(axis=0).tolist()
    file.execute(
        "INSERT INTO gpkg_contents (table_name, data_type, identifier, min_x, min_y, max_x, max_y,"
        " srs_id) VALUES (?, 'features', ?, ?, ?, ?, ?, ?)",
        (table, table, *low, *high, srs),
    )
    file.execute(
        "INSERT INTO gpkg_geometry_columns VALUES (?, 'geom', ?, ?, ?, 0)", (table, kind, srs, z)
    )
    for row, blob in zip(rows, blobs, strict=True):
        marks = ", ".join("?" * (1 + len(columns)))
        names = "".join(f', "{name}"' for name in columns)
        values = (v.isoformat() if isinstance(v, date) else v for v in row.values())
        file.execute(f'INSERT INTO "{table}" (geom{names}) VALUES ({marks})', (blob, *values))


def _sql_type(values: Sequence[Any]) -> str:
    return next((SQL_TYPES[type(value)] for value in values if value is not None), "TEXT")


def point_blob(srs: int, lon_lat_height: FloatArray) -> bytes:
    """A point with a height."""
    return _geometry_blob(srs, struct.pack("<I3d", POINT_Z, *lon_lat_height))


def line_blob(lon_lat: FloatArray) -> bytes:
    """A line through (N, 2) places, WGS84."""
    return _geometry_blob(WGS84_2D, struct.pack("<II", LINE, len(lon_lat)) + _corner_bytes(lon_lat))


def polygon_blob(ring_lon_lat: FloatArray) -> bytes:
    """A polygon of one closed (N, 2) ring, WGS84."""
    head = struct.pack("<III", POLYGON, 1, len(ring_lon_lat))
    return _geometry_blob(WGS84_2D, head + _corner_bytes(ring_lon_lat))


def _geometry_blob(srs: int, body: bytes) -> bytes:
    """The GeoPackage header (little endian, no envelope) and well-known binary."""
    return b"GP" + struct.pack("<BBi", 0, 1, srs) + b"\x01" + body


def _corner_bytes(lon_lat: FloatArray) -> bytes:
    return np.ascontiguousarray(lon_lat, dtype="<f8").tobytes()
