"""The plumes of a georeferenced map by latitude and longitude, as every map format wants them."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from geometry.arrays import FloatArray
from geometry.covariance import standard_deviations
from geometry.georeference import Georeference, HeightDatum
from locate.map.plume import Plume, PlumeMap

CONFIDENCE = 0.95
"""Probability that the ellipse holds the horizontal position."""
ELLIPSE_SIGMAS = float(np.sqrt(-2 * np.log(1 - CONFIDENCE)))
"""Standard deviations to the edge of that ellipse, two dimensions."""
ELLIPSE_POINTS = 36


@dataclass(frozen=True, kw_only=True)
class LocatedPlume:
    """A plume on the Earth.

    Attributes:
        plume: In local east-north-up.
        lat_deg: WGS84 latitude of its source.
        lon_deg: WGS84 longitude.
        height_m: Of its source, in `datum`.
        datum: What the height counts from.
        ellipsoid_height_m: Above the WGS84 ellipsoid; None where it cannot be derived.
        sea_height_m: Above mean sea level; None where it cannot be derived.
        ellipse_lon_lat: (K + 1, 2) the 95 % ellipse of the horizontal position, closed,
            counter-clockwise; longitudes run on past 180 rather than jump.
    """

    plume: Plume
    lat_deg: float
    lon_deg: float
    height_m: float
    datum: HeightDatum
    ellipsoid_height_m: float | None
    sea_height_m: float | None
    ellipse_lon_lat: FloatArray

    @property
    def name(self) -> str:
        """For people."""
        return f"Plume {self.plume.id}"

    @property
    def sentence(self) -> str:
        """What a person wants to read beside the point."""
        east, north, up = standard_deviations(self.plume.source_covariance)
        return (
            f"Source {self.height_m:.1f} m above {self.datum.words}; 1 sigma {east:.2g} m east, "
            f"{north:.2g} m north, {up:.2g} m up; probability {self.plume.probability:.3f}"
        )

    def properties(self) -> dict[str, Any]:
        """Plain values under the names of docs/files.md."""
        plume = self.plume
        east, north, up = standard_deviations(plume.source_covariance).tolist()
        return {
            "plume": plume.id,
            "height_m": self.height_m,
            "height_datum": str(self.datum),
            "sigma_east_m": east,
            "sigma_north_m": north,
            "sigma_up_m": up,
            "axis_east": float(plume.axis[0]),
            "axis_north": float(plume.axis[1]),
            "axis_up": float(plume.axis[2]),
            "axis_sigma_rad": plume.axis_sigma_rad,
            "extent_low_m": plume.extent_low,
            "extent_high_m": plume.extent_high,
            "evidence_nats": plume.evidence_nats,
            "probability": plume.probability,
            "displacement_px": plume.displacement_px,
            "views": len(plume.views),
            "source_hidden": plume.source_hidden,
            "refractive_index": plume.refractive_index or "unknown",
        }


def georeference_of(plume_map: PlumeMap) -> Georeference:
    """Where the map's frame sits on the Earth.

    Raises:
        ValueError: The map is not georeferenced.
    """
    if plume_map.georeference is None:
        raise ValueError("the map has no georeference, so its plumes have no longitude")
    return Georeference.from_dict(plume_map.georeference)


def plumes_on_earth(plume_map: PlumeMap) -> list[LocatedPlume]:
    """The plumes of a map, in its order.

    Raises:
        ValueError: The map is not georeferenced.
    """
    georeference = georeference_of(plume_map)
    sources = np.reshape([plume.source for plume in plume_map.plumes], (-1, 3))
    datum = georeference.datum
    ellipsoidal = _heights_above(georeference, HeightDatum.ELLIPSOID, sources)
    sea = _heights_above(georeference, datum if datum.is_sea_level else HeightDatum.EGM96, sources)
    return [
        LocatedPlume(
            plume=plume,
            lat_deg=float(lat),
            lon_deg=float(lon),
            height_m=float(height),
            datum=datum,
            ellipsoid_height_m=ellipsoidal[i],
            sea_height_m=sea[i],
            ellipse_lon_lat=_confidence_ellipse(plume, georeference),
        )
        for i, (plume, (lat, lon, height)) in enumerate(
            zip(plume_map.plumes, georeference.lat_lon_height(sources), strict=True)
        )
    ]


def _heights_above(
    georeference: Georeference, datum: HeightDatum, points_in_enu: FloatArray
) -> list[float | None]:
    heights = georeference.heights_in(datum, points_in_enu)
    return [None] * len(points_in_enu) if heights is None else heights.tolist()


def _confidence_ellipse(plume: Plume, georeference: Georeference) -> FloatArray:
    angles = np.linspace(0.0, 2 * np.pi, ELLIPSE_POINTS + 1)
    variances, axes = np.linalg.eigh(plume.source_covariance[:2, :2])
    axes = axes * [1.0, np.linalg.det(axes)]  # a turn, no mirror: the ring runs counter-clockwise
    circle = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    ring = ELLIPSE_SIGMAS * (circle * np.sqrt(np.maximum(variances, 0.0))) @ axes.T
    points = plume.source + np.column_stack([ring, np.zeros(len(ring))])
    lat, lon, _ = georeference.lat_lon_height(points).T
    return np.stack([np.unwrap(lon, period=360.0), lat], axis=1)
