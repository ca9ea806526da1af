"""The sources on a map of the Earth: GeoJSON, RFC 7946."""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from locate.export.located import CONFIDENCE, LocatedPlume, plumes_on_earth
from locate.map.plume import PlumeMap


def write_geojson(path: Path, plume_map: PlumeMap) -> None:
    """Writes the source of every plume as a point, then the 95 % ellipse of each as a polygon.

    Raises:
        ValueError: The map is not georeferenced.
    """
    path.write_text(json.dumps(feature_collection(plume_map), indent=1, allow_nan=False))


def feature_collection(plume_map: PlumeMap) -> dict[str, Any]:
    """The FeatureCollection of a georeferenced map, with its answer as members of their own.

    Positions are [lon, lat]. A third number of a position means a height above the WGS84 ellipsoid
    there (RFC 7946, section 4), so it is written only where that is known; the property
    ``height_m`` is always there, in the datum that ``height_datum`` names.

    Raises:
        ValueError: The map is not georeferenced.
    """
    return {
        **collection_of(plumes_on_earth(plume_map)),
        "answer": str(plume_map.answer),
        "description": plume_map.limit_text(),
    }


def collection_of(places: Sequence[LocatedPlume]) -> dict[str, Any]:
    """Likewise of places by themselves."""
    features = [_source_feature(place) for place in places] + [
        _ellipse_feature(place) for place in places
    ]
    return {"type": "FeatureCollection", "features": features}


def _source_feature(one: LocatedPlume) -> dict[str, Any]:
    position = [one.lon_deg, one.lat_deg]
    if one.ellipsoid_height_m is not None:
        position.append(one.ellipsoid_height_m)
    return {
        "type": "Feature",
        "id": one.plume.id,
        "geometry": {"type": "Point", "coordinates": position},
        "properties": {"kind": "source", **one.properties()},
    }


def _ellipse_feature(one: LocatedPlume) -> dict[str, Any]:
    return {
        "type": "Feature",
        "geometry": {"type": "Polygon", "coordinates": [one.ellipse_lon_lat.tolist()]},
        "properties": {
            "kind": "uncertainty",
            "plume": one.plume.id,
            "confidence": CONFIDENCE,
        },
    }
