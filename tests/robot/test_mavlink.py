import json
import socket
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

pytest.importorskip("pymavlink", reason="the extra `mavlink` is not installed")

from pymavlink import mavutil
from pymavlink.dialects.v20 import common as mavlink

from geometry.errors import BadInputError
from geometry.georeference.geodesy import Georeference, HeightDatum
from locate.robot import PlumeUpdate, TrackState
from locate.robot.autopilot import Autopilot, pose_from_odometry
from locate.robot.mavlink import landing_target, mission_plan, region_of_interest, status_text
from tests.robot.test_next_view import plume

ORIGIN = Georeference(lat_deg=47.4, lon_deg=8.5, height_m=450.0, datum=HeightDatum.MEAN_SEA_LEVEL)
LEAK = replace(plume(), source=np.array([100.0, 50.0, 3.0]))


def odometry(**changes: Any) -> Any:
    triangle = np.diag([1e-2, 4e-2, 9e-2, 1e-4, 1e-4, 4e-4])[np.triu_indices(6)]
    fields = {
        "time_usec": 5_000_001,
        "frame_id": mavlink.MAV_FRAME_LOCAL_NED,
        "child_frame_id": mavlink.MAV_FRAME_BODY_FRD,
        "x": 10.0,
        "y": 20.0,
        "z": -30.0,
        "q": [1.0, 0.0, 0.0, 0.0],
        "vx": 0.0,
        "vy": 0.0,
        "vz": 0.0,
        "rollspeed": 0.0,
        "pitchspeed": 0.0,
        "yawspeed": 0.0,
        "pose_covariance": triangle.tolist(),
        "velocity_covariance": [0.0] * 21,
    }
    return mavlink.MAVLink_odometry_message(**{**fields, **changes})


def test_level_flight_to_the_north() -> None:
    pose = pose_from_odometry(odometry())
    assert pose.stamp_ns == 5_000_001_000
    np.testing.assert_allclose(pose.center_in_world, [20, 10, 30])
    right, down, ahead = pose.world_from_cam[:3, :3].T
    np.testing.assert_allclose(right, [1, 0, 0], atol=1e-12)
    np.testing.assert_allclose(down, [0, 0, -1], atol=1e-12)
    np.testing.assert_allclose(ahead, [0, 1, 0], atol=1e-12)
    in_world = pose.world_from_cam[:3, :3] @ pose.covariance[3:, 3:] @ pose.world_from_cam[:3, :3].T
    np.testing.assert_allclose(np.diag(in_world), [4e-2, 1e-2, 9e-2], rtol=1e-6)
    turns = pose.world_from_cam[:3, :3] @ pose.covariance[:3, :3] @ pose.world_from_cam[:3, :3].T
    np.testing.assert_allclose(np.diag(turns), [1e-4, 1e-4, 4e-4], rtol=1e-6)


def test_yaw_to_the_east_and_nose_down() -> None:
    x, y, z, w = Rotation.from_euler("ZYX", [90, -30, 0], degrees=True).as_quat()
    ahead = pose_from_odometry(odometry(q=[w, x, y, z])).world_from_cam[:3, 2]
    np.testing.assert_allclose(ahead, [np.cos(np.pi / 6), 0, -0.5], atol=1e-6)


def test_unknown_covariance_and_frames() -> None:
    unknown = pose_from_odometry(odometry(pose_covariance=[float("nan")] + [0.0] * 20))
    assert np.isnan(unknown.covariance).all()
    for wrong in ({"frame_id": 0}, {"child_frame_id": 1}, {"q": [0.0] * 4}, {"x": float("nan")}):
        with pytest.raises(BadInputError):
            pose_from_odometry(odometry(**wrong))


def attitude(time_ms: int) -> Any:
    return mavlink.MAVLink_attitude_message(time_ms, 0.0, 0.0, np.pi / 2, 0.0, 0.0, 0.0)


def position(time_ms: int, where: list[float]) -> Any:
    lat, lon, height = ORIGIN.lat_lon_height(np.array(where))[0]
    return mavlink.MAVLink_global_position_int_message(
        time_ms, round(lat * 1e7), round(lon * 1e7), round(height * 1e3), 30_000, 0, 0, 0, 0
    )


def test_global_position_and_attitude_make_a_pose() -> None:
    autopilot = Autopilot(ORIGIN, sigma_m=1.5, boot_ns=7)
    assert autopilot.pose_from_message(position(1000, [20.0, 10.0, 30.0])) is None
    assert autopilot.pose_from_message(attitude(1000)) is None
    pose = autopilot.pose_from_message(position(1050, [20.0, 10.0, 30.0]))
    assert pose is not None
    assert pose.stamp_ns == 1_050_000_007
    np.testing.assert_allclose(pose.center_in_world, [20, 10, 30], atol=0.02)
    np.testing.assert_allclose(pose.world_from_cam[:3, 2], [1, 0, 0], atol=1e-6)
    np.testing.assert_allclose(np.diag(pose.covariance)[3:], 1.5**2)
    assert autopilot.pose_from_message(position(1200, [20.0, 10.0, 30.0])) is None
    above_start = Autopilot(replace(ORIGIN, height_m=0.0, datum=HeightDatum.TAKEOFF))
    above_start.pose_from_message(attitude(0))
    low = above_start.pose_from_message(position(0, [20.0, 10.0, 470.0]))
    assert low is not None
    assert low.center_in_world[2] == pytest.approx(30.0, abs=0.01)


def test_quaternion_says_the_same_as_angles() -> None:
    x, y, z, w = Rotation.from_euler("ZYX", [np.pi / 2, 0, 0]).as_quat()
    poses = []
    for message in (
        attitude(5),
        mavlink.MAVLink_attitude_quaternion_message(5, w, x, y, z, 0.0, 0.0, 0.0),
    ):
        autopilot = Autopilot(ORIGIN)
        autopilot.pose_from_message(message)
        poses.append(autopilot.pose_from_message(position(5, [0.0, 0.0, 0.0])))
    assert poses[0] is not None
    assert poses[1] is not None
    np.testing.assert_allclose(poses[0].world_from_cam, poses[1].world_from_cam, atol=1e-6)


def test_odometry_comes_over_a_link_and_feeds_the_autopilot() -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    robot = mavutil.mavlink_connection(f"udpin:127.0.0.1:{port}")
    flight = mavutil.mavlink_connection(f"udpout:127.0.0.1:{port}", source_system=1)
    try:
        autopilot, poses = Autopilot(ORIGIN), []
        for i in range(20):
            flight.mav.send(odometry(time_usec=i, x=float(i)))
            message = robot.recv_match(type="ODOMETRY", blocking=True, timeout=10)
            poses.append(autopilot.pose_from_message(message))
        assert [round(float(pose.center_in_world[1])) for pose in poses if pose] == [*range(20)]
    finally:
        robot.close()
        flight.close()


@pytest.mark.parametrize("datum", [HeightDatum.UNKNOWN, HeightDatum.ELLIPSOID])
def test_origin_above_something_else_is_refused(datum: HeightDatum) -> None:
    with pytest.raises(BadInputError, match="heights count from"):
        Autopilot(replace(ORIGIN, datum=datum))


def test_leak_reaches_the_other_end_of_a_link() -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    ground = mavutil.mavlink_connection(f"udpin:127.0.0.1:{port}")
    robot = mavutil.mavlink_connection(f"udpout:127.0.0.1:{port}", source_system=1)
    try:
        update = PlumeUpdate(plume=LEAK, state=TrackState.CONFIRMED, stamp_ns=0)
        robot.mav.send(status_text(update))
        robot.mav.send(region_of_interest(LEAK, ORIGIN, system=1, component=1))
        text = ground.recv_match(type="STATUSTEXT", blocking=True, timeout=10)
        assert text.text == "plume 1 confirmed: 0.5 m"
        assert text.severity == mavlink.MAV_SEVERITY_WARNING
        command = ground.recv_match(type="COMMAND_INT", blocking=True, timeout=10)
        assert command.command == mavlink.MAV_CMD_DO_SET_ROI_LOCATION
        assert command.frame == mavlink.MAV_FRAME_GLOBAL
        where = [command.x / 1e7, command.y / 1e7, command.z]
        np.testing.assert_allclose(ORIGIN.to_enu(where)[0], LEAK.source, atol=0.02)
    finally:
        robot.close()
        ground.close()


def test_landing_target_is_the_source_in_the_autopilots_local_frame() -> None:
    sender = mavlink.MAVLink(None)
    packed = landing_target(LEAK, time_us=7_000_000).pack(sender)
    (message,) = mavlink.MAVLink(None).parse_buffer(packed)
    assert message.get_type() == "LANDING_TARGET"
    assert message.frame == mavlink.MAV_FRAME_LOCAL_NED
    assert (message.x, message.y, message.z) == (50.0, 100.0, -3.0)
    assert message.position_valid == 1
    assert message.target_num == LEAK.id


def test_plan_looks_at_each_leak_and_circles_above() -> None:
    content = json.loads(json.dumps(mission_plan([LEAK, LEAK], ORIGIN)))
    items = content["mission"]["items"]
    assert [item["command"] for item in items] == [195, 17, 195, 17]
    assert [item["doJumpId"] for item in items] == [1, 2, 3, 4]
    assert all(len(item["params"]) == 7 for item in items)
    np.testing.assert_allclose(ORIGIN.to_enu(items[0]["params"][4:])[0], LEAK.source, atol=1e-6)
    above = ORIGIN.to_enu(items[1]["params"][4:])[0]
    np.testing.assert_allclose(above - LEAK.source, [0, 0, 10], atol=1e-6)


def test_heights_of_an_unknown_datum_are_refused() -> None:
    with pytest.raises(BadInputError, match="above the sea"):
        region_of_interest(LEAK, replace(ORIGIN, datum=HeightDatum.UNKNOWN), system=1, component=1)
    relative = region_of_interest(
        LEAK, replace(ORIGIN, height_m=0.0, datum=HeightDatum.TAKEOFF), system=1, component=1
    )
    assert relative.frame == mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT
    assert relative.z == pytest.approx(3.0, abs=0.01)
