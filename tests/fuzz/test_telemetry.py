"""Whatever a file holds: a sound track, or one line that refuses it."""

from pathlib import Path
from time import process_time

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from geometry.errors import BadInputError
from locate.telemetry import TelemetryTrack, read_ground_control, read_telemetry
from locate.telemetry.track import COLUMNS
from tests.fuzz.bounds import read_bounded
from tests.fuzz.damage import NASTY_BYTES, Cut, cuts, damaged, fuzzed
from tests.locate import recorded, test_gpmf


def check(path: Path) -> None:
    read_bounded(lambda path: assert_sound(read_telemetry(path)), path)


def assert_sound(found: TelemetryTrack) -> None:
    assert len(found) > 0
    for name in COLUMNS:
        values = getattr(found, name)
        assert values.dtype == np.float64
        assert not np.isinf(values).any()
    assert (np.abs(found.latitude_deg[found.has_position]) <= 90).all()
    assert (np.abs(found.longitude_deg[found.has_position]) <= 180).all()
    assert (found.has_position == np.isfinite(found.longitude_deg)).all()
    if found.times_s is not None:
        assert (np.diff(found.times_s) > 0).all()
        found.at(found.times_s + 0.01)
        found.without_repeats()
    else:
        assert len(found.names) == len(found)
        found.rows_of(found.names)
    assert found.step_m > 0


@pytest.mark.parametrize("name", recorded.TEXTS)
@fuzzed(60)
@given(found=cuts())
def test_damaged_text(tmp_path: Path, name: str, found: list[Cut]) -> None:
    path = tmp_path / name
    path.write_bytes(damaged(recorded.TEXTS[name].encode(), found))
    check(path)


@fuzzed(60)
@given(found=cuts())
def test_damaged_ground_control(tmp_path: Path, found: list[Cut]) -> None:
    path = tmp_path / "gcp_list.txt"
    path.write_bytes(damaged(recorded.GCP.encode(), found))
    try:
        found = read_ground_control(path)
    except BadInputError:
        return
    assert np.isfinite(found.altitude_m).all()


@pytest.mark.parametrize(
    "name", ["a.ulg", "b.ulg", "a.bin", "a.tlog", "a.jpg", "a.mp4", "a.mkv", "gopro.mp4"]
)
@fuzzed(60)
@given(found=cuts())
def test_damaged_binary(tmp_path: Path, name: str, found: list[Cut]) -> None:
    whole = tmp_path / f"whole_{name}"
    if not whole.exists():
        write(whole, name)
    path = tmp_path / name
    path.write_bytes(damaged(whole.read_bytes(), found))
    check(path)


def write(path: Path, name: str) -> None:
    if name.endswith(".ulg"):
        recorded.write_ulog(path, in_degrees=name.startswith("b"))
    elif name == "gopro.mp4":
        test_gpmf.write(path, [test_gpmf.gps5(0), test_gpmf.gps9(1)])
    elif name == "a.bin":
        recorded.write_bin(path)
    elif name == "a.tlog":
        recorded.write_tlog(path)
    elif name == "a.jpg":
        recorded.write_photo(path, xmp=recorded.XMP, gps=recorded.GPS_TAGS)
    else:
        codec = "mov_text" if name == "a.mp4" else "subrip"
        recorded.write_video(path, codec, recorded.SRT.split("\n\n"))


@fuzzed(60)
@given(
    content=st.one_of(st.binary(max_size=300), st.lists(st.sampled_from(NASTY_BYTES)).map(b"".join))
)
def test_noise(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "noise"
    path.write_bytes(content)
    check(path)


@pytest.mark.parametrize(
    "content",
    [
        "EPSG:4326\n" + "A " * 300_000,
        "[" * 1_000_000,
        "a" * 1_000_000,
        "gps(" * 250_000,
        "1\n00:00:00,000 --> 00:00:01,000\n" + "latitude " * 100_000,
        "1\n00:00:00,000 --> 00:00:01,000\n" + "latitude: " + "1" * 1_000_000,
        "00:00:00,000 --> 00:00:01,000\n" * 30_000,
        "latitude,longitude,time\n" + "1," * 500_000,
        "latitude,longitude,time\n" + '"' * 500_000,
        "latitude,longitude,time\n" + "9" * 1_000_000 + ",1,1\n",
        "1\t2\t[3]\t" + "4,Lat\t" * 150_000 + "5,Ellh\t",
        "<gpx>" + "<trk>" * 50_000,
        "2020-01-01 00:00:00 latitude\n" + "\n \n" * 200_000,
    ],
    ids=lambda content: content[:40],
)
def test_hostile_text_of_a_megabyte_is_answered_in_seconds(tmp_path: Path, content: str) -> None:
    (tmp_path / "a").write_text(content)
    started_s = process_time()
    check(tmp_path / "a")
    assert process_time() - started_s < 5
