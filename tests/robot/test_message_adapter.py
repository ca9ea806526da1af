from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from geometry.errors import BadInputError
from locate.messages.stamps import NS_PER_S
from locate.messages.transforms import ros_covariance
from locate.messages.wiring import Wiring
from locate.robot import LocatorSettings
from locate.robot.message_adapter import MessageAdapter
from tests.robot.fake_messages import camera_info, header, image, quaternion, vector
from tests.robot.test_transforms import stamped

SETTINGS = LocatorSettings(views_a_decision=1000, lag=0)
SMALL: dict[str, Any] = {"width": 32, "height": 24, "k": [30.0, 0, 16, 0, 30, 12, 0, 0, 1]}
GREY = np.full((24, 32), 7, np.uint8)
MOUNT = np.eye(4)
MOUNT[:3, :3] = [[0, 0, 1], [-1, 0, 0], [0, -1, 0]]
MOUNT[:3, 3] = [0.3, 0.0, 0.5]


def body(x: float) -> np.ndarray:
    pose = np.eye(4)
    pose[:3, :3] = Rotation.from_euler("z", 30, degrees=True).as_matrix()
    pose[:3, 3] = [x, 2.0, 0.0]
    return pose


def picture(stamp_ns: int) -> Any:
    message = image(GREY, "mono8")
    message.header = header(stamp_ns, "camera")
    return message


def transforms(child: str, parent: str, pose: np.ndarray, stamp_ns: int = 0) -> Any:
    return SimpleNamespace(transforms=[stamped(child, parent, pose, stamp_ns)])


def odometry(pose: np.ndarray, stamp_ns: int, covariance: np.ndarray) -> Any:
    inner = SimpleNamespace(
        position=vector(*pose[:3, 3]),
        orientation=quaternion(*Rotation.from_matrix(pose[:3, :3]).as_quat()),
    )
    return SimpleNamespace(
        header=header(stamp_ns, "odom"),
        child_frame_id="base",
        pose=SimpleNamespace(pose=inner, covariance=covariance),
    )


def make_adapter(**wiring: Any) -> MessageAdapter:
    made = MessageAdapter(Wiring(**wiring), settings=SETTINGS, threaded=False)
    made.add_camera_info(camera_info(**SMALL))
    made.add_static_transforms(transforms("camera", "base", MOUNT))
    return made


def key_poses(made: MessageAdapter) -> list[Any]:
    assert made.locator is not None
    return [key.pose for key in made.locator._selector.window._keys]


def test_tf_gives_the_pose_of_each_image() -> None:
    made = make_adapter(pose_sigma_m=0.02, pose_sigma_deg=0.5)
    made.add_image(picture(NS_PER_S + NS_PER_S // 10))
    assert key_poses(made) == []
    made.add_transforms(transforms("base", "map", body(1.0), NS_PER_S))
    made.add_transforms(transforms("base", "map", body(2.0), NS_PER_S + NS_PER_S // 5))
    (pose,) = key_poses(made)
    np.testing.assert_allclose(pose.world_from_cam, body(1.5) @ MOUNT, atol=1e-12)
    assert np.sqrt(pose.covariance[3, 3]) == pytest.approx(0.02)
    assert np.sqrt(pose.covariance[0, 0]) == pytest.approx(np.deg2rad(0.5))


def test_odometry_brings_its_covariance_to_the_camera() -> None:
    made = make_adapter(pose_source="odometry")
    given = ros_covariance(body(1.0), np.diag([0, 0, 1e-4, 1e-4, 1e-4, 1e-4]))
    made.add_image(picture(NS_PER_S))
    made.add_body_pose(odometry(body(1.0), NS_PER_S, given))
    (pose,) = key_poses(made)
    np.testing.assert_allclose(pose.world_from_cam, body(1.0) @ MOUNT, atol=1e-12)
    moved = MOUNT[:3, :3] @ pose.covariance[3:, 3:] @ MOUNT[:3, :3].T
    assert moved[1, 1] == pytest.approx(1e-4 + 0.3**2 * 1e-4)
    assert moved[0, 0] == pytest.approx(1e-4)


def test_pose_of_the_camera_itself_needs_no_tf() -> None:
    made = make_adapter(pose_source="pose")
    message = odometry(body(1.0), NS_PER_S, np.zeros(36))
    del message.child_frame_id
    message.pose = message.pose.pose
    made.add_image(picture(NS_PER_S))
    made.add_body_pose(message)
    (pose,) = key_poses(made)
    np.testing.assert_allclose(pose.world_from_cam, body(1.0), atol=1e-12)
    assert np.isnan(pose.covariance).all()


def test_troubles_are_named() -> None:
    made = MessageAdapter(Wiring(pose_source="odometry"), settings=SETTINGS, threaded=False)
    assert made.find_problem() == "no camera_info yet"
    made.add_image(picture(NS_PER_S))
    assert "camera_info" in made.find_problem()
    made.add_camera_info(camera_info(**{**SMALL, "k": [0.0] * 9}))
    assert "calibrate" in made.find_problem()
    made.add_camera_info(camera_info(**SMALL))
    made.add_image(image(GREY[:5], "mono8"))
    assert "(24, 32)" in made.find_problem()
    made.add_image(picture(NS_PER_S))
    made.add_body_pose(odometry(body(1.0), NS_PER_S, np.zeros(36)))
    assert "TF does not say where 'camera' is in 'base'" in made.find_problem()
    made.add_static_transforms(transforms("camera", "base", MOUNT))
    made.add_body_pose(odometry(body(1.0), NS_PER_S, np.zeros(36)))
    assert made.find_problem() == ""
    assert made.refusals == {"image": 2, "camera_info": 1, "pose": 1}


def test_unknown_pose_source_is_refused() -> None:
    with pytest.raises(BadInputError, match="gps"):
        Wiring(pose_source="gps")  # type: ignore[arg-type]


@pytest.mark.parametrize(
    "wrong", [{"views_kept": 0}, {"spacing": -1.0}, {"lag": 20}, {"lag": -1}, {"null_draws": 1}]
)
def test_settings_out_of_range_are_refused(wrong: dict[str, Any]) -> None:
    with pytest.raises(BadInputError, match=next(iter(wrong))):
        LocatorSettings(**wrong)


@pytest.mark.parametrize(
    "wrong",
    [
        {"width": 2**32 - 1, "height": 2**32 - 1},
        {"k": [1e300, 0, 320, 0, 510, 240, 0, 0, 1]},
        {"k": [float("inf"), 0, 320, 0, 510, 240, 0, 0, 1]},
        {"k": [500.0, 0, 320]},
        {"d": [1e300] * 5},
        {"d": [float("nan")] * 5},
        {"binning_x": 2**31},
    ],
    ids=str,
)
def test_a_camera_info_that_overflows_is_counted(wrong: dict[str, Any]) -> None:
    made = MessageAdapter(Wiring(), settings=SETTINGS, threaded=False)
    made.add_camera_info(camera_info(**wrong))
    assert made.locator is None
    assert made.refusals["camera_info"] == 1
    made.add_camera_info(camera_info(**SMALL))
    assert made.locator is not None
    made.add_camera_info(camera_info(**wrong))
    assert made.refusals["camera_info"] == 2
    made.close()


def test_tf_that_overflows_is_counted() -> None:
    made = MessageAdapter(Wiring(), settings=SETTINGS, threaded=False)
    made.add_camera_info(camera_info(**SMALL))
    made.add_image(picture(0))
    far = np.eye(4)
    far[0, 3] = 1e200
    for add in (made.add_transforms, made.add_static_transforms):
        add(transforms("camera", "map", far))
    assert made.refusals["tf"] == 2
    assert "origin" in made.last_refusal
    half = np.eye(4)
    half[0, 3] = 9e8
    made.add_transforms(transforms("camera", "base_link", half))
    made.add_transforms(transforms("base_link", "map", half))
    assert made.refusals["pose"] == 1
    made.close()
