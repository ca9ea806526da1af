"""Points of the scene as a georeferenced LAS or LAZ cloud (ASPRS LAS 1.4)."""

import importlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from geometry.arrays import FloatArray
from geometry.errors import LocateError
from geometry.georeference import Georeference, HeightDatum

POINT_FORMAT = 6
"""The simplest of LAS 1.4."""
RESOLUTION_M = 0.001
"""Step of the stored integers."""
TEXT_AREA = 3
"""Record number of the text area, LAS 1.4."""
VERTICAL = {HeightDatum.EGM96: "5773", HeightDatum.EGM2008: "3855"}
"""EPSG codes of the heights that have one."""


def write_las(
    path: Path,
    georeference: Georeference,
    points_in_enu: FloatArray,
    attributes: Mapping[str, FloatArray] | None = None,
) -> None:
    """Writes points in the UTM zone of the origin, to the millimetre.

    Heights stay in the datum of the georeference. Where that has a name in EPSG the file's
    reference system has it; in any case a text record of the file names the datum.

    Args:
        path: Ending in ``.las``, or in ``.laz`` for a compressed file.
        georeference: Where the points are.
        points_in_enu: (N, 3) in m.
        attributes: (N,) each, kept as float32 extra dimensions.

    Raises:
        LocateError: The extra ``las`` is not installed.
    """
    laspy = _import_laspy()
    header = laspy.LasHeader(version="1.4", point_format=POINT_FORMAT)
    header.generating_software = "plume-locate"
    for name in attributes or {}:
        header.add_extra_dim(laspy.ExtraBytesParams(name=name, type=np.float32))
    system = utm_system(georeference)
    header.vlrs.append(laspy.vlrs.known.WktCoordinateSystemVlr(system.to_wkt("WKT1_GDAL")))
    header.global_encoding.wkt = True
    text = f"heights above: {georeference.datum}; origin: {georeference.name}"
    header.vlrs.append(
        laspy.VLR("LASF_Spec", TEXT_AREA, "Text Area Descriptor", text.encode() + b"\0")
    )
    positions = utm_positions(georeference, points_in_enu)
    header.scales = np.full(3, RESOLUTION_M)
    header.offsets = np.floor(positions.min(axis=0)) if len(positions) else np.zeros(3)
    cloud = laspy.LasData(header)
    cloud.x, cloud.y, cloud.z = positions.T
    for name, values in (attributes or {}).items():
        cloud[name] = np.asarray(values, dtype=np.float32)
    cloud.write(path)


def utm_system(georeference: Georeference) -> Any:
    """The UTM zone of the origin (the polar system beyond 84 N and 80 S), with its heights."""
    from pyproj import CRS

    lat, lon = georeference.lat_deg, georeference.lon_deg
    zone = min(int((lon + 180) // 6) + 1, 60)
    code = f"EPSG:{(32600 if lat >= 0 else 32700) + zone}"
    if lat > 84 or lat < -80:
        code = "EPSG:5041" if lat > 0 else "EPSG:5042"
    vertical = VERTICAL.get(georeference.datum)
    return CRS(code if vertical is None else f"{code}+{vertical}")


def utm_positions(georeference: Georeference, points_in_enu: FloatArray) -> FloatArray:
    """(N, 3) easting, northing, and height in the datum of the georeference."""
    from pyproj import CRS, Transformer

    system = utm_system(georeference)
    horizontal = system.sub_crs_list[0] if system.is_compound else system
    to_utm = Transformer.from_crs(CRS("EPSG:4326"), horizontal, always_xy=True)
    lat, lon, height = georeference.lat_lon_height(points_in_enu).T
    easting, northing = to_utm.transform(lon, lat)
    return np.stack([easting, northing, height], axis=-1)


def _import_laspy() -> Any:
    try:
        return importlib.import_module("laspy")
    except ImportError as error:
        raise LocateError("LAS files need the extra: pip install 'plume-locate[las]'") from error
