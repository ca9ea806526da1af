"""Lists without a header of photo, latitude, longitude and altitude, as Pix4D writes them."""

import re
from pathlib import Path, PurePosixPath

from geometry.errors import BadInputError
from locate.recording.formats import PHOTO_SUFFIXES
from locate.telemetry.assemble import ColumnStore, track_from_columns
from locate.telemetry.cells import LENGTHS, UnknownForm, parse_coordinate, parse_quantity
from locate.telemetry.track import TelemetryTrack

KIND = "geolocation list"
FEWEST, MOST = 4, 9
"""Cells of a line: a photo and its position, and further ones of angles and accuracies."""
NOTE = (
    "has no header; its lines were read as photo, latitude, longitude, altitude, as Pix4D writes "
    "them, and nothing beyond"
)


def looks_like_geolocation(head: str) -> bool:
    """Whether the first line is the name of a photo and three numbers or more."""
    first = next((line for line in head.splitlines() if _is_record(line)), "")
    try:
        return _read_line(_cells(first)) is not None
    except UnknownForm:
        return False


def parse_geolocation(text: str, path: Path) -> TelemetryTrack:
    """Reads such a list; the datum of the altitudes is not stated.

    Raises:
        BadInputError: A line is of another form, or its latitude is none: then the order may be
            another, which a header states.
    """
    store, names = ColumnStore(), []
    for number, line in enumerate(text.splitlines(), start=1):
        if not _is_record(line):
            continue
        cells = _cells(line)
        try:
            position = _read_line(cells)
            if position is None:
                raise UnknownForm("expected photo, latitude, longitude, altitude")
        except UnknownForm as error:
            raise BadInputError(
                f"{path}, line {number}: {error}; where the order is another, write a header such "
                "as filename,longitude,latitude,altitude"
            ) from error
        names.append(cells[0])
        store.add(position)
    warning = f"{path.name}: {NOTE}"
    return track_from_columns(path, KIND, store.arrays(), names=names, warnings=(warning,))


def _is_record(line: str) -> bool:
    return bool(line.strip()) and not line.lstrip().startswith("#")


def _cells(line: str) -> list[str]:
    delimiter = next((each for each in ("\t", ";", ",") if each in line), None)
    cells = line.split(delimiter) if delimiter else re.split(r"\s+", line.strip())
    return [cell.strip().strip('"') for cell in cells]


def _read_line(cells: list[str]) -> dict[str, float] | None:
    """The position of one line; None where it is of another form.

    Raises:
        UnknownForm: A coordinate is none.
    """
    is_photo = PurePosixPath(cells[0].replace("\\", "/")).suffix.lower() in PHOTO_SUFFIXES
    if not is_photo or not FEWEST <= len(cells) <= MOST:
        return None
    comma = "," in cells[1] + cells[2]
    return {
        "latitude_deg": parse_coordinate(cells[1], "latitude"),
        "longitude_deg": parse_coordinate(cells[2], "longitude"),
        "altitude_m": parse_quantity(cells[3], LENGTHS, decimal_comma=comma),
    }
