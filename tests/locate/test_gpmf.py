"""The GPS track of GoPro videos, made by hand after the published layout."""

import struct
from collections.abc import Sequence
from fractions import Fraction
from pathlib import Path

import av
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from geometry.errors import BadInputError
from locate.telemetry import read_telemetry
from locate.telemetry.gpmf import parse_entries, parse_streams
from locate.telemetry.track import AltitudeDatum, Clock

SAMPLES = 18


def entry(key: bytes, kind: str, size: int, value: bytes) -> bytes:
    head = key + struct.pack(">BBH", ord(kind) if kind else 0, size, len(value) // size)
    return head + value + bytes(-len(value) % 4)


def group(key: bytes, *parts: bytes) -> bytes:
    return entry(key, "", 1, b"".join(parts))


def gps5(second: int, *, fix: int = 3, scale: bool = True) -> bytes:
    rows = [
        (
            round((48 + 1e-5 * (second * SAMPLES + i)) * 1e7),
            -115_000_000,
            500_000 + second,
            1500,
            150,
        )
        for i in range(SAMPLES)
    ]
    scales = struct.pack(">5i", 10**7, 10**7, 1000, 1000, 100)
    parts = [
        entry(b"GPSF", "L", 4, struct.pack(">I", fix)),
        entry(b"GPSU", "U", 16, b"2405011200%02d.500" % second),
        entry(b"GPSA", "F", 4, b"MSLV"),
        *([entry(b"SCAL", "l", 4, scales)] if scale else []),
        entry(b"GPS5", "l", 20, b"".join(struct.pack(">5i", *row) for row in rows)),
    ]
    return packet(*parts)


def gps9(second: int, *, fix: int = 3) -> bytes:
    rows = b"".join(
        struct.pack(
            ">iiiiiiiHH", 480_000_000 + 100 * i, -115_000_000, 500_000, 1500, 150,
            8887, 43_200_000 + 1000 * second + 100 * i, 120, fix,
        )
        for i in range(10)
    )  # fmt: skip
    scales = struct.pack(">9i", 10**7, 10**7, 1000, 1000, 100, 1, 1000, 100, 1)
    return packet(
        entry(b"TYPE", "c", 1, b"lllllllSS"),
        entry(b"SCAL", "l", 4, scales),
        entry(b"GPS9", "?", 32, rows),
    )


def packet(*parts: bytes) -> bytes:
    motion = group(b"STRM", entry(b"ACCL", "s", 6, bytes(12)))
    name = entry(b"DVNM", "c", 1, b"Hero")
    return group(b"DEVC", name, motion, group(b"STRM", *parts))


def write(path: Path, packets: Sequence[bytes], *, start_s: int = 0) -> Path:
    """A video of 25 frames a second with a packet a second in a track of data."""
    with av.open(str(path), "w") as container:
        video = container.add_stream("mpeg4", rate=25)
        video.width, video.height, video.pix_fmt = 64, 48, "yuv420p"
        data = container.add_data_stream("bin_data")
        data.time_base = Fraction(1, 1000)
        grey = np.random.default_rng(0).integers(0, 255, (48, 64), dtype=np.uint8)
        for i in range(25 * len(packets)):
            frame = av.VideoFrame.from_ndarray(grey, format="gray").reformat(format="yuv420p")
            frame.pts, frame.time_base = i + 25 * start_s, Fraction(1, 25)
            container.mux(video.encode(frame))
            if i % 25 == 0:
                sent = av.Packet(packets[i // 25])
                sent.stream, sent.time_base, sent.duration = data, Fraction(1, 1000), 1000
                sent.pts = sent.dts = 40 * i + 1000 * start_s
                container.mux(sent)
        container.mux(video.encode(None))
    return path


@pytest.mark.parametrize("start_s", [0, 3])
def test_positions_of_a_hero(tmp_path: Path, start_s: int) -> None:
    path = write(tmp_path / "GX010001.MP4", [gps5(0), gps5(1), gps5(2)], start_s=start_s)
    track = read_telemetry(path)
    assert track.times_s is not None
    assert len(track) == 3 * SAMPLES
    np.testing.assert_allclose(track.times_s, np.arange(54) / SAMPLES, atol=0.005)
    np.testing.assert_allclose(track.latitude_deg, 48 + 1e-5 * np.arange(54), atol=1e-7)
    assert set(track.longitude_deg) == {-11.5}
    np.testing.assert_allclose(track.altitude_m[::SAMPLES], [500, 500.001, 500.002])
    assert set(track.speed_mps) == {1.5}
    assert (track.clock, track.altitude_datum) == (Clock.UTC, AltitudeDatum.MEAN_SEA_LEVEL)
    assert track.clock_s[SAMPLES] == 1_714_564_801.5


def test_positions_of_a_later_hero(tmp_path: Path) -> None:
    track = read_telemetry(write(tmp_path / "a.mp4", [gps9(0), gps9(1)]))
    assert len(track) == 20
    np.testing.assert_allclose(track.latitude_deg[:10], 48 + 1e-5 * np.arange(10), atol=1e-7)
    assert track.altitude_datum is AltitudeDatum.UNKNOWN
    np.testing.assert_allclose(np.diff(track.clock_s[:10]), 0.1, atol=1e-6)
    assert track.clock_s[0] == 1_714_564_800.0


def test_seconds_without_a_fix_have_no_position(tmp_path: Path) -> None:
    track = read_telemetry(write(tmp_path / "a.mp4", [gps5(0, fix=0), gps5(1)]))
    assert np.isfinite(track.latitude_deg).sum() == SAMPLES
    with pytest.raises(BadInputError, match="none of 18 records of this GoPro GPMF file"):
        read_telemetry(write(tmp_path / "b.mp4", [gps5(0, fix=0)]))


def test_without_a_scale_or_gps_nothing_is_read(tmp_path: Path) -> None:
    with pytest.raises(BadInputError, match="none of 18 records"):
        read_telemetry(write(tmp_path / "a.mp4", [gps5(0, scale=False)]))
    with pytest.raises(BadInputError, match="its GoPro telemetry holds no GPS"):
        read_telemetry(write(tmp_path / "b.mp4", [packet()]))


def test_other_tracks_of_data_are_none_of_a_gopro(tmp_path: Path) -> None:
    with pytest.raises(BadInputError, match="no telemetry inside this video"):
        read_telemetry(write(tmp_path / "a.mp4", [b"timecode"]))


@given(st.binary(max_size=200), st.integers(0, 600))
def test_damaged_packets_end_soon(noise: bytes, at: int) -> None:
    whole = gps5(0)
    for content in (noise, whole[:at], whole[:at] + noise + whole[at + len(noise) :]):
        assert sum(len(found.value) for found in parse_entries(content)) <= len(content)
        list(parse_streams(content))
