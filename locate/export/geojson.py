"""The sources on a map of the Earth: GeoJSON, RFC 7946."""

import json
from pathlib import Path
from typing import Any

import numpy as np

from geometry.arrays import FloatArray
from locate.plume import Plume, PlumeMap


def write_geojson(path: Path, plume_map: PlumeMap) -> None:
    """Writes one point feature per plume.

    Raises:
        ValueError: The map is not georeferenced.
    """
    path.write_text(json.dumps(feature_collection(plume_map), indent=1, allow_nan=False))


def feature_collection(plume_map: PlumeMap) -> dict[str, Any]:
    """The FeatureCollection of a georeferenced map; positions are [lon, lat, height].

    Raises:
        ValueError: The map is not georeferenced.
    """
    if plume_map.georeference is None:
        raise ValueError("the map has no georeference, so its plumes have no longitude")
    georeference = plume_map.georeference
    sources = np.reshape([plume.source for plume in plume_map.plumes], (-1, 3))
    positions = lon_lat_height(sources, georeference)
    features = [
        {
            "type": "Feature",
            "id": plume.id,
            "geometry": {"type": "Point", "coordinates": position.tolist()},
            "properties": _properties(plume) | {"height_datum": georeference["height_datum"]},
        }
        for plume, position in zip(plume_map.plumes, positions, strict=True)
    ]
    return {"type": "FeatureCollection", "features": features}


def lon_lat_height(points_in_enu: FloatArray, georeference: dict[str, Any]) -> FloatArray:
    """Longitude and latitude (deg, WGS84) and height (m) of local east-north-up points.

    Args:
        points_in_enu: (N, 3) in m.
        georeference: The block of map.json; heights come out in its datum.

    Returns:
        (N, 3) of longitude, latitude, height.
    """
    from pyproj import Transformer

    pipeline = (
        "+proj=pipeline +step +inv +proj=topocentric +ellps=WGS84"
        " +lat_0={origin_lat_deg} +lon_0={origin_lon_deg} +h_0={origin_height_m}"
        " +step +inv +proj=cart +ellps=WGS84"
        " +step +proj=unitconvert +xy_in=rad +xy_out=deg"
    )
    transformer = Transformer.from_pipeline(pipeline.format(**georeference))
    return np.stack(transformer.transform(*points_in_enu.T), axis=-1)


def _properties(plume: Plume) -> dict[str, Any]:
    east, north, up = np.sqrt(np.diag(plume.source_covariance))
    return {
        "sigma_east_m": float(east),
        "sigma_north_m": float(north),
        "sigma_up_m": float(up),
        "axis_enu": plume.axis.tolist(),
        "axis_sigma_rad": plume.axis_sigma_rad,
        "extent_low_m": plume.extent_low,
        "extent_high_m": plume.extent_high,
        "evidence_nats": plume.evidence_nats,
        "probability": plume.probability,
        "displacement_px": plume.displacement_px,
        "views": len(plume.views),
        "source_hidden": plume.source_hidden,
    }
