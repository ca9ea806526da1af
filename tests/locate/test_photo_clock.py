"""Photos without positions, beside a log: matched by the times they were taken."""

from datetime import UTC, datetime, timedelta
from pathlib import Path

import numpy as np
import pytest

from geometry.errors import BadInputError
from locate.telemetry import read_telemetry, telemetry_candidates
from locate.telemetry.photo_clock import moments_of_photos
from tests.locate import recorded

START = datetime(2024, 5, 1, 12, 0, 0, tzinfo=UTC)
STEP_S, COUNT = 30, 5


def write_gpx(path: Path, minutes: int = 20, *, before_min: int = 5) -> Path:
    begin = START - timedelta(minutes=before_min)
    points = "".join(
        f'<trkpt lat="{47 + 1e-5 * i:.6f}" lon="8.5"><ele>500</ele>'
        f"<time>{begin + timedelta(seconds=10 * i):%Y-%m-%dT%H:%M:%SZ}</time></trkpt>"
        for i in range(6 * minutes + 1)
    )
    head = '<?xml version="1.0"?><gpx version="1.1" xmlns="http://www.topografix.com/GPX/1/1">'
    path.write_text(f"{head}<trk><trkseg>{points}</trkseg></trk></gpx>")
    return path


def write_photos(folder: Path, zone_h: float, *, states_zone: bool = False) -> list[str]:
    folder.mkdir()
    names = [f"{i}.jpg" for i in range(COUNT)]
    for i, name in enumerate(names):
        taken = START + timedelta(hours=zone_h, seconds=STEP_S * i)
        exif = {0x9003: f"{taken:%Y:%m:%d %H:%M:%S}"}
        zone = {0x9011: f"{int(zone_h):+03d}:00"} if states_zone else {}
        recorded.write_photo(folder / name, exif=exif | zone)
    return names


EXPECTED_S = 300.0 + STEP_S * np.arange(COUNT)
"""On a log that begins five minutes before the first photo."""


@pytest.mark.parametrize("states_zone", [False, True])
@pytest.mark.parametrize("zone_h", [-7, 0, 2])
def test_the_zone_of_photos_is_found(tmp_path: Path, zone_h: int, states_zone: bool) -> None:
    names = write_photos(tmp_path / "photos", zone_h, states_zone=states_zone)
    track = read_telemetry(write_gpx(tmp_path / "photos.gpx"))
    found = moments_of_photos(tmp_path / "photos", names, track)
    np.testing.assert_allclose(found.times_s, EXPECTED_S)
    assert ("(UTC)" if states_zone else f"UTC{zone_h:+d}.") in found.notes[0]


def test_several_zones_or_none_are_refused(tmp_path: Path) -> None:
    names = write_photos(tmp_path / "photos", 2)
    long = read_telemetry(write_gpx(tmp_path / "long.gpx", minutes=90))
    with pytest.raises(BadInputError, match=r"UTC\+1 and UTC\+2 would put all of them"):
        moments_of_photos(tmp_path / "photos", names, long)
    other = read_telemetry(write_gpx(tmp_path / "other.gpx", minutes=20, before_min=30))
    with pytest.raises(BadInputError, match="no zone would put all of them into the log"):
        moments_of_photos(tmp_path / "photos", names, other)
    stated = moments_of_photos(tmp_path / "photos", names, long, offset_s=-7200.0)
    np.testing.assert_allclose(stated.times_s, EXPECTED_S)


def test_photos_and_logs_without_times_are_refused(tmp_path: Path) -> None:
    names = write_photos(tmp_path / "photos", 2)
    recorded.write_photo(tmp_path / "a.jpg")
    track = read_telemetry(write_gpx(tmp_path / "a.gpx"))
    with pytest.raises(BadInputError, match="photos state no time"):
        moments_of_photos(tmp_path, ["a.jpg"], track)
    (tmp_path / "a.csv").write_text("time,lat,lon\n0,47,8\n1,47.00001,8\n")
    with pytest.raises(BadInputError, match="no time of day"):
        moments_of_photos(tmp_path / "photos", names, read_telemetry(tmp_path / "a.csv"))


def test_logs_in_and_beside_a_folder_are_found(tmp_path: Path) -> None:
    folder = tmp_path / "photos"
    write_photos(folder, 2)
    inside, beside = write_gpx(folder / "walk.gpx"), write_gpx(tmp_path / "photos.gpx")
    write_gpx(tmp_path / "other.gpx")
    assert telemetry_candidates(folder) == (folder, inside, beside)
