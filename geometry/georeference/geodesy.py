"""Where a local east-north-up frame sits on the Earth, and what its heights are counted from."""

from dataclasses import dataclass
from enum import StrEnum
from functools import cached_property
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike

from geometry.arrays import FloatArray
from geometry.errors import BadInputError
from geometry.json_values import as_number


class HeightDatum(StrEnum):
    """What heights are counted from; the value is the label used in files."""

    ELLIPSOID = "WGS84 ellipsoid"
    EGM96 = "mean sea level (EGM96)"
    EGM2008 = "mean sea level (EGM2008)"
    MEAN_SEA_LEVEL = "mean sea level"
    TAKEOFF = "take-off"
    UNKNOWN = "unknown"

    @property
    def is_sea_level(self) -> bool:
        """Heights above the sea, whichever geoid defines it (they agree to about a metre)."""
        return self in (HeightDatum.EGM96, HeightDatum.EGM2008, HeightDatum.MEAN_SEA_LEVEL)

    @property
    def words(self) -> str:
        """What follows "height above" in a sentence."""
        return "a datum that is not stated" if self is HeightDatum.UNKNOWN else str(self)

    @property
    def epsg_code(self) -> str | None:
        """The EPSG code of WGS84 latitude, longitude and this height; None where there is none."""
        return _CRS.get(self)


_CRS = {
    HeightDatum.ELLIPSOID: "EPSG:4979",
    HeightDatum.EGM96: "EPSG:9707",
    HeightDatum.EGM2008: "EPSG:9518",
}


@dataclass(frozen=True, kw_only=True)
class Georeference:
    """A local east-north-up frame: x east, y north, z up, metres, tangent at its origin.

    Heights go through in the datum of the origin: a height above the sea comes out as a height
    above the sea. Only `heights_in` changes the datum, and only with a geoid grid.

    Attributes:
        lat_deg: WGS84 latitude of the origin.
        lon_deg: WGS84 longitude of the origin, -180 to 180.
        height_m: Height of the origin in `datum`.
        datum: What heights are counted from.
        name: What the origin is, for people.
    """

    lat_deg: float
    lon_deg: float
    height_m: float
    datum: HeightDatum
    name: str = "origin"

    def __post_init__(self) -> None:
        numbers = (self.lat_deg, self.lon_deg, self.height_m)
        if not np.isfinite(numbers).all() or abs(self.lat_deg) > 90 or abs(self.lon_deg) > 180:
            raise BadInputError(
                f"origin at latitude {self.lat_deg}, longitude {self.lon_deg}, height "
                f"{self.height_m} is not on the Earth; latitude comes first, in degrees"
            )

    def lat_lon_height(self, points_in_enu: ArrayLike) -> FloatArray:
        """(N, 3) latitude and longitude (deg, WGS84) and height (m, in `datum`) of local points.

        Heights above the sea are carried as if the geoid were parallel to the ellipsoid over the
        extent of the scene, which tilts them by the deflection of the vertical, rarely above 3e-4.
        """
        east, north, up = np.reshape(np.asarray(points_in_enu, dtype=float), (-1, 3)).T
        lon, lat, height = self._geodetic_from_enu.transform(east, north, up)
        return np.stack([lat, lon, height], axis=-1)

    def to_enu(self, lat_lon_height: ArrayLike) -> FloatArray:
        """(N, 3) local points of (N, 3) latitude and longitude (deg), height (m, in `datum`)."""
        lat, lon, height = np.reshape(np.asarray(lat_lon_height, dtype=float), (-1, 3)).T
        points = self._geodetic_from_enu.transform(lon, lat, height, direction="INVERSE")
        return np.stack(points, axis=-1)

    def heights_in(self, datum: HeightDatum, points_in_enu: ArrayLike) -> FloatArray | None:
        """(N,) heights of local points in another datum.

        Returns:
            None where the two are not related, or PROJ has no geoid grid here
            (``projsync --file egm96`` fetches one).
        """
        from pyproj import Transformer
        from pyproj.exceptions import ProjError

        positions = self.lat_lon_height(points_in_enu)
        if datum == self.datum:
            return positions[:, 2]
        if self.datum.epsg_code is None or datum.epsg_code is None:
            return None
        try:
            change = Transformer.from_crs(
                self.datum.epsg_code, datum.epsg_code, only_best=True, allow_ballpark=False
            )
            heights = np.asarray(change.transform(*positions.T), dtype=float)[2]
        except ProjError:
            return None
        return heights if np.isfinite(heights).all() else None

    def to_dict(self) -> dict[str, Any]:
        """The keys of the ``georeference`` block of map.json that hold the origin."""
        return {
            "origin_name": self.name,
            "origin_lat_deg": self.lat_deg,
            "origin_lon_deg": self.lon_deg,
            "origin_height_m": self.height_m,
            "height_datum": str(self.datum),
        }

    @classmethod
    def from_dict(cls, block: dict[str, Any]) -> Self:
        """Reads the ``georeference`` block of map.json.

        Raises:
            BadInputError: A key is missing, or the origin is not on the Earth.
        """
        try:
            return cls(
                lat_deg=as_number(block["origin_lat_deg"], "origin_lat_deg"),
                lon_deg=as_number(block["origin_lon_deg"], "origin_lon_deg"),
                height_m=as_number(block["origin_height_m"], "origin_height_m"),
                datum=HeightDatum(block["height_datum"]),
                name=str(block.get("origin_name", "origin")),
            )
        except (KeyError, TypeError, ValueError) as error:
            raise BadInputError(f"georeference lacks a valid {error}") from error

    @classmethod
    def from_origin(cls, lat_lon_height: ArrayLike, datum: HeightDatum, name: str) -> Self:
        """The frame whose origin is a position of (latitude, longitude, height)."""
        lat, lon, height = np.asarray(lat_lon_height, dtype=float)
        return cls(
            lat_deg=float(lat), lon_deg=float(lon), height_m=float(height), datum=datum, name=name
        )

    @cached_property
    def _geodetic_from_enu(self) -> Any:
        from pyproj import Transformer

        # Stated: some tools take GRS80 for the default ellipsoid, and EPSG:4326 drops the height.
        return Transformer.from_pipeline(
            "+proj=pipeline +step +inv +proj=topocentric +ellps=WGS84"
            f" +lat_0={self.lat_deg:.17g} +lon_0={self.lon_deg:.17g} +h_0={self.height_m:.17g}"
            " +step +inv +proj=cart +ellps=WGS84"
            " +step +proj=unitconvert +xy_in=rad +xy_out=deg"
        )
