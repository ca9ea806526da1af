"""The two text files of OpenDroneMap: geo.txt (photos) and gcp_list.txt (ground control)."""

import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from pyproj import Transformer
from pyproj.exceptions import ProjError

from geometry.arrays import FloatArray
from geometry.errors import BadInputError
from locate.telemetry.assemble import track_from_columns
from locate.telemetry.bounded import read_telemetry_text
from locate.telemetry.track import TelemetryTrack

KIND = "ODM geo.txt"
_PROJECTION = re.compile(r"\s*(EPSG:\d{4,6}|\+proj=[^\n]{1,300}|WGS84 UTM \d{1,2}[NS])\s*\n", re.I)
_NUMBER = re.compile(r"[-+]?\d{1,12}(?:\.\d{0,15})?(?:[eE][-+]?\d{1,3})?")
_COLUMNS = (
    "longitude_deg",
    "latitude_deg",
    "altitude_m",
    "vehicle_yaw_deg",
    "vehicle_pitch_deg",
    "vehicle_roll_deg",
    "horizontal_sigma_m",
    "vertical_sigma_m",
)


@dataclass(frozen=True, kw_only=True)
class GroundControl:
    """M sightings of surveyed points in photos.

    Attributes:
        path: Where they were read.
        longitude_deg: (M,) WGS84.
        latitude_deg: (M,) WGS84.
        altitude_m: (M,) as the file gives it, of a datum it does not name.
        pixels: (M, 2) x and y in the photo as the file gives them, from its top left corner.
        photos: Name of the photo of each sighting.
        points: Name of the point of each sighting; empty where it has none.
    """

    path: Path
    longitude_deg: FloatArray
    latitude_deg: FloatArray
    altitude_m: FloatArray
    pixels: FloatArray
    photos: tuple[str, ...]
    points: tuple[str, ...]


def looks_like_odm(head: str) -> bool:
    """Whether a text begins with a projection, as both files do."""
    return bool(_PROJECTION.match(head))


def parse_geo(text: str, path: Path) -> TelemetryTrack:
    """Reads a geo.txt: name, x, y, z, yaw, pitch, roll, horizontal and vertical accuracy.

    Missing columns at the end of a line are allowed; three angles of 0 mean that none are known.

    Raises:
        BadInputError: It is a gcp_list.txt, or nothing in it can be read.
    """
    transformer, rows = _read_rows(text, path)
    if rows and _parse_number(rows[0][0]) == _parse_number(rows[0][0]):
        raise BadInputError(
            f"{path}: a list of ground control points: positions of points, not of the camera"
        )
    values = np.full((len(rows), len(_COLUMNS)), np.nan)
    for row, words in zip(values, rows, strict=True):
        numbers = [_parse_number(word) for word in words[1 : 1 + len(_COLUMNS)]]
        row[: len(numbers)] = numbers
    values[:, :2] = np.column_stack(transformer.transform(values[:, 0], values[:, 1]))
    values[(values[:, 3:6] == 0).all(axis=1), 3:6] = np.nan
    columns = dict(zip(_COLUMNS, values.T, strict=True))
    return track_from_columns(path, KIND, columns, names=[words[0] for words in rows])


def read_ground_control(path: Path) -> GroundControl:
    """Reads a gcp_list.txt: x, y, z, pixel x, pixel y, photo, and the point's name if any.

    Raises:
        BadInputError: Nothing in it can be read.
    """
    transformer, rows = _read_rows(read_telemetry_text(path), path)
    values = np.array(
        [[_parse_number(word) for word in words[:5]] for words in rows if len(words) > 5]
    )
    named = [words for words in rows if len(words) > 5]
    if not len(values) or not np.isfinite(values).all():
        raise BadInputError(f"{path}: not a readable gcp_list.txt (x y z pixel_x pixel_y photo)")
    longitude, latitude = transformer.transform(values[:, 0], values[:, 1])
    return GroundControl(
        path=path,
        longitude_deg=np.asarray(longitude),
        latitude_deg=np.asarray(latitude),
        altitude_m=values[:, 2],
        pixels=values[:, 3:5],
        photos=tuple(words[5] for words in named),
        points=tuple(words[6] if len(words) > 6 else "" for words in named),
    )


def _read_rows(text: str, path: Path) -> tuple[Transformer, list[list[str]]]:
    first = _PROJECTION.match(text)
    if first is None:
        raise BadInputError(f"{path}: its first line names no projection (such as EPSG:4326)")
    try:
        transformer = Transformer.from_crs(_crs_name(first.group(1)), "EPSG:4326", always_xy=True)
    except ProjError as error:
        raise BadInputError(f"{path}: {first.group(1)!r} is no known projection") from error
    lines = text[first.end() :].splitlines()
    rows = [line.split() for line in lines if line.strip() and not line.startswith("#")]
    return transformer, [words for words in rows if len(words) > 2]


def _crs_name(text: str) -> str:
    utm = re.fullmatch(r"WGS84 UTM (\d{1,2})([NS])", text, re.I)
    if utm is None:
        return text
    return f"EPSG:{326 if utm.group(2).upper() == 'N' else 327}{int(utm.group(1)):02d}"


def _parse_number(word: str) -> float:
    return float(word) if _NUMBER.fullmatch(word) else float("nan")
