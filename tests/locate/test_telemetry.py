"""Every telemetry format against values written down here, and what a track can do."""

import struct
import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from geometry.errors import BadInputError
from geometry.text_files import MOST_TEXT_BYTES
from locate.telemetry import (
    AltitudeDatum,
    Clock,
    TelemetryTrack,
    read_ground_control,
    read_telemetry,
    telemetry_candidates,
    ulog,
)
from locate.telemetry.assemble import track_from_columns
from locate.telemetry.bounded import MAX_LOG_BYTES, MAX_TEXT_LINES, read_telemetry_text
from locate.telemetry.clock import parse_date_time
from locate.telemetry.streams import yaw_pitch_roll_deg
from tests.locate import recorded

NOON_S = 1_682_942_400.0  # 2023-05-01 12:00:00


def read(folder: Path, name: str, content: str) -> TelemetryTrack:
    path = folder / name
    path.write_text(content)
    return read_telemetry(path)


def track(**columns: object) -> TelemetryTrack:
    arrays = {name: np.asarray(values, dtype=float) for name, values in columns.items()}
    return track_from_columns(Path("here"), "test", arrays)


def test_srt_of_new_drones(tmp_path: Path) -> None:
    found = read(tmp_path, "a.srt", recorded.SRT)
    assert found.times_s == pytest.approx([0, 1])
    assert found.latitude_deg == pytest.approx([47.1, 47.1001], abs=1e-9)
    assert found.longitude_deg == pytest.approx([8.5, 8.5002], abs=1e-9)
    assert found.altitude_m == pytest.approx([520.25, 521.25])
    assert found.altitude_datum is AltitudeDatum.UNKNOWN
    assert found.height_m == pytest.approx([20.5, 21.5])
    assert found.gimbal_pitch_deg == pytest.approx([-45.5, -45.5])
    assert found.gimbal_yaw_deg == pytest.approx([10, 12])
    assert found.clock is Clock.LOCAL
    assert found.clock_s == pytest.approx([NOON_S + 0.25, NOON_S + 1.25])


def test_srt_of_old_drones_gives_longitude_first_and_heights_above_takeoff(tmp_path: Path) -> None:
    found = read(tmp_path, "a.srt", recorded.SRT_OLD)
    assert found.times_s == pytest.approx([1, 2])
    assert found.latitude_deg == pytest.approx([47.1, 47.1001])
    assert found.longitude_deg == pytest.approx([8.5, 8.5001])
    assert found.altitude_m == pytest.approx([20.1, 20.6])
    assert found.altitude_datum is AltitudeDatum.TAKEOFF
    assert found.step_m == pytest.approx(11.1, abs=0.1)


def test_srt_of_the_matrice_300_gives_latitude_first(tmp_path: Path) -> None:
    text = "1\n00:00:00,000 --> 00:00:01,000\nGPS(36.6146,-6.1120,12.0M) BAROMETER:3.5M\n"
    found = read(tmp_path, "a.srt", text)
    where = (found.latitude_deg[0], found.longitude_deg[0], found.altitude_m[0], found.height_m[0])
    assert where == pytest.approx((36.6146, -6.112, 12, 3.5))


def test_srt_with_angles_and_speed(tmp_path: Path) -> None:
    found = read(tmp_path, "a.srt", recorded.SRT_RTK)
    gimbal = (found.gimbal_yaw_deg[0], found.gimbal_pitch_deg[0], found.gimbal_roll_deg[0])
    vehicle = (found.vehicle_yaw_deg[0], found.vehicle_pitch_deg[0], found.vehicle_roll_deg[0])
    assert gimbal == pytest.approx((110.4, -24.4, 0.0))
    assert vehicle == pytest.approx((110.1, 2.7, -7.0))
    assert found.speed_mps[0] == pytest.approx(5.5)


def test_a_number_cut_off_at_the_end_of_a_file_is_not_read(tmp_path: Path) -> None:
    cut = recorded.SRT[: recorded.SRT.rindex("8.500200") + 3]
    assert cut.endswith("[longitude: 8.5")
    found = read(tmp_path, "a.srt", cut)
    assert len(found) == 1
    assert found.longitude_deg == pytest.approx([8.5], abs=1e-9)


def test_gpx(tmp_path: Path) -> None:
    found = read(tmp_path, "a.gpx", recorded.GPX)
    assert found.times_s == pytest.approx([0, 2.5])
    assert found.altitude_m == pytest.approx([520.5, 530.5])
    assert found.altitude_datum is AltitudeDatum.MEAN_SEA_LEVEL
    assert (found.clock, found.clock_s[0]) == (Clock.UTC, NOON_S)


def test_gpx_times_without_a_zone_are_utc_wherever_this_runs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "a.gpx").write_text(recorded.GPX.replace("00Z<", "00<").replace("2.5Z<", "2.5<"))
    with monkeypatch.context() as patched:
        patched.setenv("TZ", "America/New_York")
        time.tzset()
        track = read_telemetry(tmp_path / "a.gpx")
    time.tzset()
    np.testing.assert_allclose(track.clock_s, [1_682_942_400, 1_682_942_402.5])


def test_gpx_without_track_points_is_refused(tmp_path: Path) -> None:
    (tmp_path / "a.gpx").write_text(recorded.GPX.replace("trkpt", "wpt"))
    with pytest.raises(BadInputError, match="GPX without track points"):
        read_telemetry(tmp_path / "a.gpx")


def test_an_entity_bomb_is_refused(tmp_path: Path) -> None:
    bomb = (
        '<?xml version="1.0"?><!DOCTYPE gpx [<!ENTITY a "aaaa"><!ENTITY b "&a;&a;">]><gpx>&b;</gpx>'
    )
    with pytest.raises(BadInputError, match="document type"):
        read(tmp_path, "a.gpx", bomb)
    recorded.write_photo(tmp_path / "a.jpg", xmp=bomb.replace("gpx", "x:xmpmeta"))
    with pytest.raises(BadInputError, match="none of 1 records"):
        read_telemetry(tmp_path / "a.jpg")


def test_csv_by_time(tmp_path: Path) -> None:
    found = read(tmp_path, "a.csv", recorded.CSV)
    assert found.times_s == pytest.approx([0, 0.5])
    assert found.altitude_m == pytest.approx([560.5, 561.5])
    assert found.altitude_datum is AltitudeDatum.ELLIPSOID
    assert found.horizontal_sigma_m == pytest.approx([0.5, 0.6])
    assert found.gimbal_pitch_deg == pytest.approx([-90, -89])


def test_csv_units_zones_and_decimal_forms(tmp_path: Path) -> None:
    text = (
        "time(millisecond);datetime(utc);Latitude;Longitude;height_above_takeoff(feet);speed(mph)\n"
        '500;2023-05-01 12:00:00;"47 deg 30\' 36.00"" S";8,5;100;10\n'
        "1500;2023-05-01 12:00:01;-47.51;-8.25;200;20\n"
    )
    found = read(tmp_path, "a.csv", text)
    assert found.times_s == pytest.approx([0.5, 1.5])
    assert found.latitude_deg == pytest.approx([-47.51, -47.51])
    assert found.longitude_deg[1] == pytest.approx(-8.25)
    assert found.height_m == pytest.approx([30.48, 60.96])
    assert found.speed_mps == pytest.approx([4.4704, 8.9408])
    assert (found.clock, found.clock_s[0]) == (Clock.UTC, NOON_S)


def test_mrk_by_the_number_of_the_photo(tmp_path: Path) -> None:
    found = read(tmp_path, "a.mrk", recorded.MRK)
    one = found.named("100_0021_0003.JPG")
    assert one.latitude_deg == pytest.approx([47.647917 - 0.0042690830], abs=1e-8)
    assert one.altitude_m == pytest.approx([512.996])
    assert one.altitude_datum is AltitudeDatum.ELLIPSOID
    assert one.horizontal_sigma_m == pytest.approx([0.05 / np.sqrt(2)])
    assert one.vertical_sigma_m == pytest.approx([0.05])
    assert found.rows_of(["DJI_0002.JPG", "DJI_0004.JPG"]).tolist() == [0, -1]


@pytest.mark.parametrize(
    "line",
    ["{},47.1,8.5,520", "{}\t47.1\t8.5\t520\t1\t2\t3", "{} 47.1 8.5 520", "{};47,1;8,5;520,0"],
)
def test_lists_without_a_header(tmp_path: Path, line: str) -> None:
    path = tmp_path / "geo.txt"
    path.write_text("".join(line.format(f"{name}.JPG") + "\n" for name in "ab"))
    track = read_telemetry(path)
    assert track.names == ("a.JPG", "b.JPG")
    assert (track.latitude_deg[0], track.longitude_deg[0]) == (47.1, 8.5)
    assert track.altitude_m[0] == 520
    assert "has no header; its lines were read as photo, latitude, longitude" in track.warnings[0]


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ("b.JPG,147.1,8.5,520", "line 2: beyond the largest latitude"),
        ("b.JPG,47.1,8.5", "line 2: expected photo, latitude, longitude, altitude"),
        ("b.JPG,47.1,8.5,high", "line 2: no known form of a number"),
        ("b,47.1,8.5,520", "line 2: expected photo"),
    ],
)
def test_lines_of_another_form_are_refused(tmp_path: Path, line: str, said: str) -> None:
    (tmp_path / "geo.txt").write_text(f"a.JPG,47.1,8.5,520\n{line}\n")
    with pytest.raises(BadInputError, match=said):
        read_telemetry(tmp_path / "geo.txt")


@pytest.mark.parametrize("unit", [1, 10**3, 10**6, 10**9])
def test_times_since_1970_in_any_unit(tmp_path: Path, unit: int) -> None:
    stamps = [1_714_564_800 * unit + i * unit // 2 for i in range(4)]
    if unit == 1:
        stamps = [1_714_564_800.0 + i / 2 for i in range(4)]
    rows = (f"{stamp},47.{i},8.5\n" for i, stamp in enumerate(stamps))
    (tmp_path / "a.csv").write_text("timestamp,lat,lon\n" + "".join(rows))
    track = read_telemetry(tmp_path / "a.csv")
    assert track.times_s is not None
    np.testing.assert_allclose(track.times_s, [0, 0.5, 1, 1.5], atol=1e-5)
    assert track.clock_s[0] == 1_714_564_800


def test_times_of_no_unit_are_refused(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text("timestamp,lat,lon\n50000000000,47.1,8.5\n")
    with pytest.raises(BadInputError, match="no time since 1970 in s, ms, us or ns"):
        read_telemetry(tmp_path / "a.csv")


def test_decimal_commas_of_times(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text("time;lat;lon\n0,5;47,1;8,5\n1,0;47,1001;8,5\n")
    track = read_telemetry(tmp_path / "a.csv")
    assert track.times_s is not None
    assert track.times_s.tolist() == [0.5, 1.0]


def test_camera_references_of_metashape(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text(
        "# CoordinateSystem: WGS 84\n#Label,X/Longitude,Y/Latitude,Z/Altitude,Error_(m)\n"
        "a.jpg,8.5,47.1,520.5,0.1\nb.jpg,8.6,47.2,530.5,0.2\n"
    )
    track = read_telemetry(tmp_path / "a.csv")
    assert track.names == ("a.jpg", "b.jpg")
    assert track.latitude_deg.tolist() == [47.1, 47.2]
    assert track.longitude_deg.tolist() == [8.5, 8.6]
    assert track.altitude_m.tolist() == [520.5, 530.5]
    (tmp_path / "b.csv").write_text("time,label,lat,lon\n0,hover,47.1,8.5\n1,hover,47.1,8.5\n")
    assert read_telemetry(tmp_path / "b.csv").names == ()


def test_geoinfo(tmp_path: Path) -> None:
    found = read(tmp_path, "a.txt", recorded.GEOINFO)
    assert found.names == ("IMG_1.JPG",)
    assert found.altitude_m == pytest.approx([255.8])
    assert found.altitude_datum is AltitudeDatum.ELLIPSOID
    assert found.vehicle_yaw_deg == pytest.approx([149.4])


def test_geo_txt_in_utm(tmp_path: Path) -> None:
    found = read(tmp_path, "geo.txt", recorded.GEO)
    assert found.longitude_deg == pytest.approx([9.0, 9.000131], abs=1e-6)  # 500 km is 9 degrees
    assert found.latitude_deg == pytest.approx([46.953529, 46.953529], abs=1e-6)
    assert found.vehicle_yaw_deg[0] == pytest.approx(10)
    assert found.vertical_sigma_m[0] == pytest.approx(1.5)
    assert np.isnan([found.altitude_m[1], found.vehicle_yaw_deg[1]]).all()


def test_ground_control_is_not_where_the_camera_was(tmp_path: Path) -> None:
    with pytest.raises(BadInputError, match="ground control points"):
        read(tmp_path, "gcp_list.txt", recorded.GCP)
    found = read_ground_control(tmp_path / "gcp_list.txt")
    assert found.longitude_deg == pytest.approx([9.0])
    assert found.pixels.tolist() == [[1203.5, 802.25]]
    assert (found.photos, found.points) == (("DJI_0001.JPG",), ("corner",))


def test_photos(tmp_path: Path) -> None:
    recorded.write_photo(tmp_path / "a10.jpg", xmp=recorded.XMP, gps=recorded.GPS_TAGS)
    recorded.write_photo(tmp_path / "a9.jpg", gps={**recorded.GPS_TAGS, 5: 1, 31: (2.5,)})
    recorded.write_photo(tmp_path / "b.jpg")
    found = read_telemetry(tmp_path)
    assert found.names == ("a9.jpg", "a10.jpg")
    assert found.times_s is None
    assert found.latitude_deg == pytest.approx([-46.51, -46.51])
    assert found.longitude_deg == pytest.approx([-91.255, -91.255])
    assert found.altitude_m == pytest.approx([-198.25, 198.25])
    assert found.altitude_datum is AltitudeDatum.MEAN_SEA_LEVEL
    assert found.horizontal_sigma_m == pytest.approx([2.5, 0.05 / np.sqrt(2)])
    assert found.gimbal_pitch_deg[1] == pytest.approx(-89.9)
    assert found.height_m[1] == pytest.approx(39.8)
    assert (found.clock, found.clock_s[0]) == (Clock.UTC, NOON_S + 1815)


def test_positions_of_heic_photos(tmp_path: Path) -> None:
    pytest.importorskip("pi_heif", reason="the extra `heif` is not installed")
    pillow_heif = pytest.importorskip("pillow_heif", reason="nothing here writes HEIC")
    exif = recorded.exif_block(recorded.GPS_TAGS)
    photo = pillow_heif.from_bytes(mode="RGB", size=(64, 48), data=bytes(64 * 48 * 3))
    photo.save(tmp_path / "a.heic", exif=exif)
    for path in (tmp_path, tmp_path / "a.heic"):
        track = read_telemetry(path)
        assert track.names == ("a.heic",)
        np.testing.assert_allclose([track.latitude_deg, track.longitude_deg], [[-46.51], [-91.255]])
        assert track.altitude_m[0] == 198.25


def test_a_photo_may_say_that_its_height_is_ellipsoidal(tmp_path: Path) -> None:
    recorded.write_photo(tmp_path / "a.jpg", gps={**recorded.GPS_TAGS, 5: 2})
    assert read_telemetry(tmp_path / "a.jpg").altitude_datum is AltitudeDatum.ELLIPSOID
    named = 'drone-dji:AltitudeType="RtkAlt" drone-dji:RtkStdLat'
    rtk = recorded.XMP.replace("drone-dji:RtkStdLat", named)
    recorded.write_photo(tmp_path / "a.jpg", gps=recorded.GPS_TAGS, xmp=rtk)
    assert read_telemetry(tmp_path / "a.jpg").altitude_datum is AltitudeDatum.ELLIPSOID


def test_a_photo_without_fix_has_no_position(tmp_path: Path) -> None:
    recorded.write_photo(tmp_path / "a.jpg", gps={**recorded.GPS_TAGS, 9: "V"}, xmp=recorded.XMP)
    found = read_telemetry(tmp_path / "a.jpg")
    assert np.isnan(found.latitude_deg[0])
    assert found.gimbal_yaw_deg[0] == pytest.approx(45)


@pytest.mark.parametrize("in_degrees", [False, True])
def test_ulog(tmp_path: Path, in_degrees: bool) -> None:
    recorded.write_ulog(tmp_path / "a.ulg", in_degrees=in_degrees)
    found = read_telemetry(tmp_path / "a.ulg")
    assert found.times_s == pytest.approx([0, 0.2])
    assert found.latitude_deg == pytest.approx([63.5, 63.50001])
    assert found.altitude_m == pytest.approx([100, 100])
    assert found.altitude_datum is AltitudeDatum.ELLIPSOID
    assert found.vehicle_yaw_deg == pytest.approx([90, 90], abs=1e-4)
    assert (found.horizontal_sigma_m[0], found.vertical_sigma_m[0]) == (1.5, 2.5)
    assert found.clock_s == pytest.approx([1.6e9, 1.6e9 + 0.2], abs=1e-3)


def test_ardupilot_bin(tmp_path: Path) -> None:
    recorded.write_bin(tmp_path / "a.bin")
    found = read_telemetry(tmp_path / "a.bin")
    assert found.times_s == pytest.approx([0, 0.2])
    assert found.latitude_deg == pytest.approx([-35.5, -35.49999])
    assert (found.altitude_m[0], found.height_m[0]) == pytest.approx((600, 20))
    assert (found.horizontal_sigma_m[0], found.vertical_sigma_m[0]) == pytest.approx((1.5, 2.5))
    attitude = (found.vehicle_yaw_deg[0], found.vehicle_pitch_deg[0], found.vehicle_roll_deg[0])
    assert attitude == pytest.approx((-90, -2, 1))
    assert (found.gimbal_yaw_deg[0], found.gimbal_pitch_deg[0]) == pytest.approx((45, -90))
    gps_s = 315_964_800 + 2300 * 604_800 + 302_400 - 18
    assert (found.clock, found.clock_s[0]) == (Clock.UTC, pytest.approx(gps_s))


def test_mavlink_tlog_of_the_first_vehicle(tmp_path: Path) -> None:
    recorded.write_tlog(tmp_path / "a.tlog")
    found = read_telemetry(tmp_path / "a.tlog")
    assert len(found) == 2
    assert found.longitude_deg == pytest.approx([149.5000001] * 2, abs=1e-9)
    assert (found.altitude_m[0], found.height_m[0]) == pytest.approx((600, 20))
    assert (found.horizontal_sigma_m[0], found.vertical_sigma_m[0]) == pytest.approx((1.5, 2.5))
    assert found.vehicle_yaw_deg[0] == pytest.approx(np.degrees(0.3))
    assert found.gimbal_pitch_deg[0] == pytest.approx(-60, abs=1e-5)


@pytest.mark.parametrize(("name", "codec"), [("a.mp4", "mov_text"), ("a.mkv", "subrip")])
def test_subtitles_inside_the_video(tmp_path: Path, name: str, codec: str) -> None:
    recorded.write_video(tmp_path / name, codec, recorded.SRT.split("\n\n"))
    found = read_telemetry(tmp_path / name)
    assert found.times_s == pytest.approx([0, 1])
    assert found.latitude_deg == pytest.approx([47.1, 47.1001])


def test_a_video_without_telemetry_takes_the_file_beside_it(tmp_path: Path) -> None:
    video = tmp_path / "DJI_1.MP4"
    recorded.write_video(video, "mov_text", ["hello"])
    with pytest.raises(BadInputError, match="has a camera position"):
        read_telemetry(video)
    assert telemetry_candidates(video) == (video,)
    sidecar = tmp_path / "DJI_1.SRT"
    sidecar.write_text(recorded.SRT)
    assert telemetry_candidates(video) == (video, sidecar)
    assert read_telemetry(sidecar).kind == "DJI SRT"


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("empty.srt", b"", "is empty"),
        ("noise.bin", b"\x00\x01\x02" * 100, "not a readable video"),
        ("prose.txt", b"It was a dark and stormy night\n", "no telemetry is recognised"),
        ("film.srt", b"1\n00:00:01,000 --> 00:00:02,000\nHello\n", "has a camera position"),
        ("bad.gpx", b"<gpx><trk>", "not a readable GPX"),
        ("no.csv", b"time,latitude,longitude\n", "has a camera position"),
        ("loose.csv", b"latitude,longitude\n47.1,8.5\n", "neither usable times nor photo names"),
        ("crs.txt", b"EPSG:99999\nA.JPG 1 2 3\n", "no known projection"),
        ("a.ulg", b"ULog\x01\x12\x35\x01" + bytes(8), "position"),
        ("a.bin", b"\xa3\x95\x80" + bytes(200), "ArduPilot"),
    ],
)
def test_what_cannot_be_used_is_refused_in_one_line(
    tmp_path: Path, name: str, content: bytes, message: str
) -> None:
    path = tmp_path / name
    path.write_bytes(content)
    with pytest.raises(BadInputError, match=message) as refused:
        read_telemetry(path)
    assert "\n" not in str(refused.value)
    assert str(refused.value).startswith(str(path))


def test_a_log_that_runs_in_circles_is_refused(tmp_path: Path) -> None:
    recorded.write_bin(tmp_path / "a.bin")
    content = (tmp_path / "a.bin").read_bytes()
    empty = b"\xa3\x95\x80" + bytes([7, 0]) + b"GPS\0" + bytes(16) + bytes(64)
    (tmp_path / "b.bin").write_bytes(content[:89] + empty + b"\xa3\x95\x07" + bytes(3000))
    with pytest.raises(BadInputError, match="runs in circles"):
        read_telemetry(tmp_path / "b.bin")


def test_what_is_over_the_limit_is_refused_unread(tmp_path: Path) -> None:
    with (tmp_path / "a.srt").open("wb") as file:
        file.write(b" " * (MOST_TEXT_BYTES + 1))
    with pytest.raises(BadInputError, match="over 64 MiB"):
        read_telemetry_text(tmp_path / "a.srt")
    (tmp_path / "a.srt").write_bytes(b"\n" * (MAX_TEXT_LINES + 1))
    with pytest.raises(BadInputError, match="over 2000000 lines"):
        read_telemetry_text(tmp_path / "a.srt")
    with (tmp_path / "a.ulg").open("wb") as file:
        file.write(ulog.MAGIC)
        file.truncate(MAX_LOG_BYTES + 1)
    with pytest.raises(BadInputError, match="over 256 MiB"):
        read_telemetry(tmp_path / "a.ulg")


def test_values_that_cannot_be_become_nan() -> None:
    found = track(
        times_s=[0, 1, 2, 3],
        latitude_deg=[47, 999, 0, 47],
        longitude_deg=[8, 8, 0, 188],
        altitude_m=[500, 1e300, np.nan, -np.inf],
        horizontal_sigma_m=[0.5, 0.0, -1.0, 1e9],
        gimbal_pitch_deg=[-90, -90, -90, 1e6],
    )
    assert found.has_position.tolist() == [True, False, False, True]
    assert found.longitude_deg[3] == pytest.approx(-172)
    assert np.isfinite(found.altitude_m).tolist() == [True, False, False, False]
    assert np.isfinite(found.horizontal_sigma_m).tolist() == [True, False, False, False]
    assert np.isnan(found.gimbal_pitch_deg[3])
    assert "2 of 4 records have no position" in found.warnings[0]


def test_time_that_runs_backwards_is_sorted_and_said() -> None:
    found = track(times_s=[2, 0, 0, 1], latitude_deg=[3, 1, 9, 2], longitude_deg=[8, 8, 8, 8])
    assert found.times_s == pytest.approx([0, 1, 2])
    assert found.latitude_deg == pytest.approx([1, 2, 3])
    assert "backwards" in found.warnings[0]


def test_interpolation_goes_the_short_way_round_and_not_over_gaps() -> None:
    found = track(
        times_s=[0, 1, 10],
        latitude_deg=[10, 20, 30],
        longitude_deg=[179, -179, -178],
        gimbal_yaw_deg=[170, -170, -160],
        gimbal_pitch_deg=[-90, np.nan, -60],
    )
    at = found.at(np.array([-0.3, 0.5, 1.0, 5.0, 10.0]))
    assert at.latitude_deg == pytest.approx([np.nan, 15, 20, np.nan, 30], nan_ok=True)
    assert abs(at.longitude_deg[1]) == pytest.approx(180)
    assert at.gimbal_yaw_deg[1] == pytest.approx(-180)
    assert at.gimbal_pitch_deg == pytest.approx([np.nan] * 4 + [-60], nan_ok=True)
    wide = found.at(np.array([5.5]), max_gap_s=20)
    assert wide.latitude_deg == pytest.approx([25])


def test_the_ends_hold_for_stamps_that_were_rounded() -> None:
    """Frames at 30 a second against subtitles in whole ms; and no further than the spacing."""
    frames_s = np.arange(6) / 30
    found = track(times_s=np.round(frames_s, 3), latitude_deg=np.arange(6.0), longitude_deg=[8] * 6)
    at = found.at(np.array([-0.03, frames_s[-1], frames_s[-1] + 0.03, frames_s[-1] + 0.05]))
    assert at.latitude_deg == pytest.approx([0, 5, 5, np.nan], abs=0.02, nan_ok=True)


def test_the_gaps_of_a_phone_are_its_spacing() -> None:
    for spacing_s, gap_s in ((0.2, 2.0), (2.0, 6.0), (5.0, 10.0)):
        times_s = spacing_s * np.arange(5)
        phone = track(times_s=times_s, latitude_deg=[1, 2, 3, 4, 5], longitude_deg=[8] * 5)
        assert phone.usual_gap_s == pytest.approx(gap_s)


def test_a_staircase_is_taken_at_its_steps() -> None:
    times_s = np.arange(0, 4, 0.1)
    steps = np.where(times_s < 2, np.floor(times_s / 0.5) * 0.5, 2.0)
    found = track(times_s=times_s, latitude_deg=10 + steps, longitude_deg=steps)
    moved = found.without_repeats()
    assert moved.times_s == pytest.approx([0, 0.5, 1, 1.5, 2, 3.9])
    assert moved.at(np.array([0.75])).latitude_deg == pytest.approx([10.75])


def test_records_of_photos_have_no_times(tmp_path: Path) -> None:
    found = read(tmp_path, "a.mrk", recorded.MRK)
    with pytest.raises(BadInputError, match="have no times"):
        found.at(np.zeros(1))
    with pytest.raises(BadInputError, match=r"no record of x\.jpg"):
        found.named("x.jpg")


@pytest.mark.parametrize(
    ("text", "seconds", "zoned"),
    [
        ("2023-05-01T12:00:00Z", NOON_S, True),
        ("2023:05:01 14:00:00.5+02:00", NOON_S + 0.5, True),
        ("2023-05-01 12:00:00,745,078", NOON_S + 0.745078, False),
        ("2023.5.1 12:00:00", NOON_S, False),
        ("2023-02-30 12:00:00", np.nan, False),
        ("noon", np.nan, False),
    ],
)
def test_dates(text: str, seconds: float, zoned: bool) -> None:
    found, is_utc = parse_date_time(text)
    assert found == pytest.approx(seconds, abs=1e-6, nan_ok=True)
    assert is_utc == zoned


def test_quaternions_turn_in_the_order_yaw_pitch_roll() -> None:
    from scipy.spatial.transform import Rotation

    angles = np.array([[30.0, -40.0, 10.0], [-170.0, 20.0, -5.0]])
    xyzw = Rotation.from_euler("ZYX", angles, degrees=True).as_quat()
    found = yaw_pitch_roll_deg(np.column_stack([xyzw[:, 3], xyzw[:, :3]]))
    assert np.column_stack(found) == pytest.approx(angles)
    assert np.isnan(yaw_pitch_roll_deg([[0.0, 0.0, 0.0, 0.0]])).all()


@pytest.mark.parametrize(
    ("write", "missing"),
    [
        (recorded.write_ulog, "pyulog"),
        (recorded.write_bin, "pymavlink"),
        (recorded.write_tlog, "pymavlink"),
    ],
)
def test_a_missing_extra_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, write: Callable[[Path], None], missing: str
) -> None:
    write(tmp_path / "a")
    monkeypatch.setitem(sys.modules, missing, None)
    with pytest.raises(BadInputError, match="pip install"):
        read_telemetry(tmp_path / "a")


@pytest.mark.parametrize(
    ("tags", "latitude", "note"),
    [
        ({2: "46.51"}, -46.51, ""),
        ({2: "46 30 36"}, -46.51, ""),
        ({2: "123"}, np.nan, "beyond the largest latitude"),
        ({2: "4x6.5"}, np.nan, "no known form of a coordinate"),
        ({2: (46, 75, 36)}, np.nan, "no degrees, minutes and seconds"),
        ({2: (46.51,)}, np.nan, "no degrees, minutes and seconds"),
        ({1: ""}, np.nan, "its hemisphere is not given"),
        ({1: "E"}, np.nan, "E is no side of a latitude"),
        ({1: "South"}, -46.51, ""),
    ],
)
def test_positions_in_exif_are_read_exactly_or_left_out_with_a_note(
    tmp_path: Path, tags: dict[int, object], latitude: float, note: str
) -> None:
    recorded.write_photo(tmp_path / "a.jpg", gps=recorded.GPS_TAGS)
    recorded.write_photo(tmp_path / "b.jpg", gps=recorded.GPS_TAGS | tags)
    found = read_telemetry(tmp_path)
    assert found.latitude_deg == pytest.approx([-46.51, latitude], nan_ok=True)
    assert found.has_position.tolist() == [True, not np.isnan(latitude)]
    assert any(note in warning and "b.jpg" in warning for warning in found.warnings) or not note
    if note:
        with pytest.raises(BadInputError, match=note) as refused:
            read_telemetry(tmp_path / "b.jpg")
        assert "\n" not in str(refused.value)


@pytest.mark.parametrize(("text", "metres"), [("198.25 m", 198.25), ("123", 123), ("12x", np.nan)])
def test_altitudes_in_exif_that_are_text(tmp_path: Path, text: str, metres: float) -> None:
    recorded.write_photo(tmp_path / "a.jpg", gps={**recorded.GPS_TAGS, 6: text})
    found = read_telemetry(tmp_path / "a.jpg")
    assert found.altitude_m == pytest.approx([metres], nan_ok=True)
    assert found.latitude_deg == pytest.approx([-46.51])
    assert any("GPS altitude" in warning for warning in found.warnings) == np.isnan(metres)


def ulog_of(*messages: tuple[str, bytes]) -> bytes:
    """A ULog of the given messages: kind and body."""
    packed = [struct.pack("<HB", len(body), ord(kind)) + body for kind, body in messages]
    return ulog.MAGIC + b"\x01" + bytes(8) + b"".join(packed)


UNFOLDING = ulog_of(
    ("F", b"a:b[60000] x;"), ("F", b"b:c[60000] x;"), ("F", b"c:;"), ("A", b"\0\0\0a")
)
CYCLIC = ulog_of(("F", b"a:" + b"a " + b"x" * 30_000 + b";"), ("A", b"\0\0\0a"))
LONG_NAMES = ulog_of(("F", b"a:float[65535] " + b"x" * 60_000 + b";"), ("A", b"\0\0\0a"))
MANY = ulog_of(
    ("F", b"a:float[60000] x;"), *(("A", struct.pack("<BH", 0, i) + b"a") for i in range(1000))
)


@pytest.mark.parametrize("content", [UNFOLDING, CYCLIC, LONG_NAMES, MANY])
def test_a_ulog_that_unfolds_without_end_is_refused(tmp_path: Path, content: bytes) -> None:
    (tmp_path / "a.ulg").write_bytes(content)
    with pytest.raises(BadInputError, match="too many fields"):
        read_telemetry(tmp_path / "a.ulg")


@pytest.mark.parametrize("size", [21, 34])
def test_a_ulog_whose_parser_steps_back_for_ever_is_refused(tmp_path: Path, size: int) -> None:
    cut = struct.pack("<HB", size, 0) + bytes(20)
    (tmp_path / "a.ulg").write_bytes(ulog_of(("I", b"\x06char x123")) + cut)
    with pytest.raises(BadInputError, match="runs in circles"):
        read_telemetry(tmp_path / "a.ulg")
