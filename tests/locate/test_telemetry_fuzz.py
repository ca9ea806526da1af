"""Whatever a file holds: a sound track, or one line that refuses it."""

import os
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from geometry.errors import BadInputError
from locate.telemetry import TelemetryTrack, read_ground_control, read_telemetry
from locate.telemetry.track import COLUMNS
from tests.locate import recorded

EXAMPLES = int(os.environ.get("LOCATE_FUZZ_EXAMPLES", "60"))
FUZZED = settings(
    max_examples=EXAMPLES,
    deadline=None,
    derandomize="LOCATE_FUZZ_EXAMPLES" not in os.environ,
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)
NASTY = [
    *(b"nan", b"inf", b"-1e999", b"1e308", b"999", b"-0", b"9" * 400, b"0" * 40, b"1/0"),
    *(b"\n", b"\n\n", b"\r", b"\0", b"\xff\xfe", b"\xef\xbb\xbf", b",", b'"', b"\t", b" "),
    *(b"-->", b"GPS(", b")", b"[", b"]", b"<", b">", b"<!ENTITY a 'b'>", b"\xd9\xa3", b"%n"),
    *(b"2023-99-99 25:61:61", b"9999-12-31T23:59:59Z", b"0001-01-01 00:00:00", b"99:99:99,999"),
    *(b"\xff\xff\xff\xff", b"\x7f\xff\xff\xff", b"\0\0\0\0", b"\xa3\x95\x80", b"EPSG:4326\n"),
]


@st.composite
def damage(draw: st.DrawFn) -> list[tuple[float, float, bytes]]:
    """Cuts: where each begins (0 to 1), how long it is (bytes over 40), what takes its place."""
    place = st.floats(0, 1)
    filling = st.one_of(st.sampled_from(NASTY), st.binary(max_size=8), st.just(b""))
    return draw(st.lists(st.tuples(place, place, filling), min_size=1, max_size=6))


def damaged(content: bytes, cuts: list[tuple[float, float, bytes]]) -> bytes:
    for place, size, filling in cuts:
        start = round(place * len(content))
        content = content[:start] + filling + content[start + round(size * 40) :]
    return content


def check(path: Path) -> None:
    refusal = ""
    try:
        assert_sound(read_telemetry(path))
    except BadInputError as error:
        refusal = str(error)
    assert "\n" not in refusal


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
@FUZZED
@given(cuts=damage())
def test_damaged_text(tmp_path: Path, name: str, cuts: list[tuple[float, float, bytes]]) -> None:
    path = tmp_path / name
    path.write_bytes(damaged(recorded.TEXTS[name].encode(), cuts))
    check(path)


@FUZZED
@given(cuts=damage())
def test_damaged_ground_control(tmp_path: Path, cuts: list[tuple[float, float, bytes]]) -> None:
    path = tmp_path / "gcp_list.txt"
    path.write_bytes(damaged(recorded.GCP.encode(), cuts))
    try:
        found = read_ground_control(path)
    except BadInputError:
        return
    assert np.isfinite(found.altitude_m).all()


@pytest.mark.parametrize("name", ["a.ulg", "b.ulg", "a.bin", "a.tlog", "a.jpg", "a.mp4", "a.mkv"])
@FUZZED
@given(cuts=damage())
def test_damaged_binary(tmp_path: Path, name: str, cuts: list[tuple[float, float, bytes]]) -> None:
    whole = tmp_path / f"whole_{name}"
    if not whole.exists():
        write(whole, name)
    path = tmp_path / name
    path.write_bytes(damaged(whole.read_bytes(), cuts))
    check(path)


def write(path: Path, name: str) -> None:
    if name.endswith(".ulg"):
        recorded.write_ulog(path, in_degrees=name.startswith("b"))
    elif name == "a.bin":
        recorded.write_bin(path)
    elif name == "a.tlog":
        recorded.write_tlog(path)
    elif name == "a.jpg":
        recorded.write_photo(path, xmp=recorded.XMP, gps=recorded.GPS_TAGS)
    else:
        codec = "mov_text" if name == "a.mp4" else "subrip"
        recorded.write_video(path, codec, recorded.SRT.split("\n\n"))


@FUZZED
@given(content=st.one_of(st.binary(max_size=300), st.lists(st.sampled_from(NASTY)).map(b"".join)))
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
    from time import process_time

    (tmp_path / "a").write_text(content)
    started_s = process_time()
    check(tmp_path / "a")
    assert process_time() - started_s < 5
