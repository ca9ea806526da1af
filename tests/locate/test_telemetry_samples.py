"""Files that real drones and receivers wrote: each parses, or is refused with the right line."""

from pathlib import Path

import numpy as np
import pytest

from geometry.errors import BadInputError
from locate.telemetry import AltitudeDatum, read_ground_control, read_telemetry

E, M, T, U = (
    AltitudeDatum.ELLIPSOID,
    AltitudeDatum.MEAN_SEA_LEVEL,
    AltitudeDatum.TAKEOFF,
    AltitudeDatum.UNKNOWN,
)
# file: records, latitude and longitude of the first, duration in s (None: photos), datum
READ = {
    "dji_srt/MAVIC3_first400k.srt": (1376, 3.41531, -3.37440, 27.5, U),
    "dji_srt/air2s.srt": (17, 41.424724, 2.234156, 0.533, U),
    "dji_srt/broken_incomplete.SRT": (19, -34.7383, -58.4563, 18, T),
    "dji_srt/broken_incomplete2.SRT": (4, -34.869950, -57.823395, 0.16, U),
    "dji_srt/m2zoom_first400k.SRT": (1351, 31.452012, 74.398751, 22.522, U),
    "dji_srt/matrice_300.srt": (381, 36.6146, -6.1120, 380, T),
    "dji_srt/mavic_2_style.SRT": (463, -20.2533, 149.0251, 468, U),
    "dji_srt/mavic_2pro_new_first400k.SRT": (1453, -35.080155, -60.286702, 60.92, U),
    "dji_srt/mavic_air2.srt": (25, 41.420684, 2.162162, 0.4, U),
    "dji_srt/mavic_mini.SRT": (117, 48.0771, -121.7458, 116, T),
    "dji_srt/mavic_pro.SRT": (468, -20.2533, 149.0251, 467, T),
    "dji_srt/mavic_pro_buggy.SRT": (546, 42.4668, -1.2218, 545, T),
    "dji_srt/mix_p4rtk_mavic2pro.srt": (12, -34.650200, -59.409424, 5.338, U),
    "dji_srt/old_format.SRT": (468, -20.2533, 149.0251, 467, T),
    "dji_srt/p4_rtk.SRT": (55, -34.237922, -58.851745, 54, T),
    "dji_srt/p4p_sample.SRT": (5, 47.4692, 8.2090, 4, T),
    "dji_rtk/101FTASK_Timestamp.mrk": (176, 47.6436873208, 16.4759271684, None, E),
    "ebee_geoinfo/snowpea1_geoinfo.txt": (140, 37.5448893, 139.0398406, None, E),
    "dji_image_metadata_csv/agung1_image_metadata.csv": (48, -8.295155, 115.487408, None, U),
    "px4_ulog/sample_log_small.ulg": (32, 63.4170622, 10.4082151, 6.187, E),
    "gpx_ground/around-visnjan-with-car.gpx": (104, 45.273518851, 13.7142099626, 514, M),
}
REFUSED = {
    "dji_srt/broken_empty.SRT": "is empty",
    "dji_srt/broken_empty2.SRT": "no telemetry is recognised",
    "dji_srt/mavic_air.SRT": "none of 2 records of this DJI SRT file has a camera position",
    "dji_rtk/gcp_list.txt": "ground control points",
    "gpx_ground/Mojstrovka.gpx": "neither usable times nor photo names",  # all in December 1901
}


def test_every_sample_has_an_expected_outcome(shared_data: Path) -> None:
    folder = shared_data / "2_telemetry"
    files = {str(p.relative_to(folder)) for p in folder.rglob("*") if p.is_file()}
    assert files == READ.keys() | REFUSED.keys()


@pytest.mark.parametrize("name", READ)
def test_sample_is_read(shared_data: Path, name: str) -> None:
    count, latitude, longitude, duration_s, datum = READ[name]
    found = read_telemetry(shared_data / "2_telemetry" / name)
    assert len(found) == count
    assert (found.latitude_deg[0], found.longitude_deg[0]) == pytest.approx(
        (latitude, longitude), abs=1e-6
    )
    assert found.altitude_datum is datum
    if duration_s is None:
        assert found.times_s is None
        assert len(found.names) == count
    else:
        assert found.times_s is not None
        assert np.ptp(found.times_s) == pytest.approx(duration_s, abs=1e-3)


@pytest.mark.parametrize("name", REFUSED)
def test_sample_is_refused(shared_data: Path, name: str) -> None:
    path = shared_data / "2_telemetry" / name
    with pytest.raises(BadInputError) as refused:
        read_telemetry(path)
    line = str(refused.value)
    assert line.startswith(str(path))
    assert REFUSED[name] in line
    assert "\n" not in line


def test_angles_of_the_phantom_4_rtk(shared_data: Path) -> None:
    found = read_telemetry(shared_data / "2_telemetry/dji_srt/p4_rtk.SRT")
    gimbal = (found.gimbal_yaw_deg[0], found.gimbal_pitch_deg[0], found.gimbal_roll_deg[0])
    assert gimbal == pytest.approx((110.4, -24.4, 0.0))


def test_receiver_lost_and_found(shared_data: Path) -> None:
    found = read_telemetry(shared_data / "2_telemetry/dji_srt/mavic_pro_buggy.SRT")
    assert (~found.has_position).sum() == 16  # GPS(N/A,N/A,12)
    assert "16 of 546" in found.warnings[0]


def test_ground_control_of_helenenschacht(shared_data: Path) -> None:
    found = read_ground_control(shared_data / "2_telemetry/dji_rtk/gcp_list.txt")
    assert len(found.photos) == 35
    assert set(found.points) == {"1", "2", "3", "4", "5"}


def test_photos_with_xmp(shared_data: Path) -> None:
    found = read_telemetry(shared_data / "2_sfm/drone_brighton_beach_gps/images_half")
    assert len(found) == 18
    one = found.named("DJI_0018.JPG")
    assert one.latitude_deg[0] == pytest.approx(46 + 50 / 60 + 33.3855 / 3600)
    assert one.longitude_deg[0] == pytest.approx(-(91 + 59 / 60 + 40.4156 / 3600))
    assert (one.altitude_m[0], one.height_m[0]) == pytest.approx((198.309, 39.8))
    assert (one.gimbal_yaw_deg[0], one.gimbal_pitch_deg[0]) == pytest.approx((45, -89.9))
    assert one.altitude_datum is M


def test_photos_with_exif_alone(shared_data: Path) -> None:
    found = read_telemetry(shared_data / "2_sfm/drone_caliterra_gps/images_half")
    assert found.has_position.sum() == 24
    assert found.clock_s[0] == pytest.approx(1_413_742_851)  # 2014-10-19 18:20:51 UTC
    assert np.isnan(found.gimbal_pitch_deg).all()


def test_photos_without_gps_are_refused(shared_data: Path) -> None:
    with pytest.raises(BadInputError, match="none of 50 records"):
        read_telemetry(shared_data / "2_sfm/fox_handheld/images")


@pytest.mark.parametrize("name", ["Family", "lady-running", "teddybear"])
def test_videos_without_telemetry_are_refused(shared_data: Path, name: str) -> None:
    with pytest.raises(BadInputError, match="no telemetry inside this video"):
        read_telemetry(shared_data / f"2_video_plume_free/{name}.mp4")
