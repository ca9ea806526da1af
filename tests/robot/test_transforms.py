from types import SimpleNamespace
from typing import Any

import gtsam
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from geometry.errors import BadInputError
from locate.messages.poses import PoseBuffer, StampedPose
from locate.messages.stamps import NS_PER_S
from locate.messages.transforms import (
    TransformTree,
    camera_covariance,
    pose_matrix,
    ros_covariance,
    tangent_covariance,
)
from tests.robot.fake_messages import header, quaternion, vector


def random_pose(rng: np.random.Generator) -> np.ndarray:
    pose = np.eye(4)
    pose[:3, :3] = Rotation.random(random_state=int(rng.integers(1 << 30))).as_matrix()
    pose[:3, 3] = rng.normal(size=3)
    return pose


def random_covariance(rng: np.random.Generator) -> np.ndarray:
    root = rng.normal(size=(6, 6)) * 0.003
    return root @ root.T + 1e-6 * np.eye(6)


def stamped(child: str, parent: str, pose: np.ndarray, stamp_ns: int = 0) -> Any:
    transform = SimpleNamespace(
        translation=vector(*pose[:3, 3]),
        rotation=quaternion(*Rotation.from_matrix(pose[:3, :3]).as_quat()),
    )
    return SimpleNamespace(
        header=header(stamp_ns, parent), child_frame_id=child, transform=transform
    )


def test_covariance_is_that_of_sampled_poses() -> None:
    rng = np.random.default_rng(0)
    pose = random_pose(rng)
    given = random_covariance(rng)
    draws = rng.multivariate_normal(np.zeros(6), given, size=20_000)
    middle = gtsam.Pose3(pose)
    tangents = []
    for draw in draws:
        moved = pose.copy()
        moved[:3, 3] += draw[:3]
        moved[:3, :3] = Rotation.from_rotvec(draw[3:]).as_matrix() @ pose[:3, :3]
        tangents.append(middle.localCoordinates(gtsam.Pose3(moved)))
    expected = np.cov(np.array(tangents).T)
    found = tangent_covariance(pose, given.ravel())
    np.testing.assert_allclose(found, expected, atol=0.05 * np.abs(expected).max())
    np.testing.assert_allclose(ros_covariance(pose, found), given.ravel(), atol=1e-12)


def test_covariance_of_the_camera_on_a_body() -> None:
    rng = np.random.default_rng(1)
    body, mount = random_pose(rng), random_pose(rng)
    covariance = random_covariance(rng)
    draws = rng.multivariate_normal(np.zeros(6), covariance, size=20_000)
    middle = gtsam.Pose3(body @ mount)
    moved = [gtsam.Pose3(body).retract(draw) * gtsam.Pose3(mount) for draw in draws]
    expected = np.cov(np.array([middle.localCoordinates(pose) for pose in moved]).T)
    found = camera_covariance(mount, covariance)
    np.testing.assert_allclose(found, expected, atol=0.05 * np.abs(expected).max())


@pytest.mark.parametrize("given", [np.zeros(36), np.diag([-1.0] * 6).ravel(), np.full(36, np.nan)])
def test_unknown_covariances_stay_unknown(given: np.ndarray) -> None:
    assert np.isnan(tangent_covariance(np.eye(4), given)).all()


def test_zero_quaternion_is_refused() -> None:
    with pytest.raises(BadInputError):
        pose_matrix(vector(0, 0, 0), quaternion(0, 0, 0, 0))


def test_tree_finds_ways_up_and_down() -> None:
    rng = np.random.default_rng(2)
    odom, base, camera, gripper = (random_pose(rng) for _ in range(4))
    tree = TransformTree()
    tree.add([stamped("camera", "base", camera), stamped("gripper", "base", gripper)], static=True)
    tree.add([stamped("base", "odom", base, NS_PER_S)], static=False)
    tree.add([stamped("/odom", "/map", odom, NS_PER_S)], static=False)
    found = tree.find("map", "camera", NS_PER_S)
    np.testing.assert_allclose(found, odom @ base @ camera)
    found = tree.find("gripper", "camera", NS_PER_S)
    np.testing.assert_allclose(found, np.linalg.inv(gripper) @ camera, atol=1e-12)


def test_tree_holds_only_what_was_added() -> None:
    tree = TransformTree()
    assert tree.find("map", "camera", NS_PER_S) is None
    tree.add([stamped("base", "map", np.eye(4), NS_PER_S)], static=False)
    assert tree.find("map", "base", 2 * NS_PER_S) is None
    assert tree.find("map", "camera", NS_PER_S) is None


def test_tree_interpolates() -> None:
    tree = TransformTree()
    ahead = np.eye(4)
    ahead[0, 3] = 1.0
    ahead[:3, :3] = Rotation.from_euler("z", 90, degrees=True).as_matrix()
    tree.add(
        [
            stamped("base", "map", np.eye(4), NS_PER_S),
            stamped("base", "map", ahead, 5 * NS_PER_S // 4),
        ],
        static=False,
    )
    found = tree.find("map", "base", NS_PER_S + NS_PER_S // 8)
    assert found is not None
    assert found[0, 3] == pytest.approx(0.5)
    assert Rotation.from_matrix(found[:3, :3]).as_euler("zyx", degrees=True)[0] == pytest.approx(45)


def test_loop_in_the_tree_ends() -> None:
    tree = TransformTree()
    tree.add([stamped("a", "b", np.eye(4)), stamped("b", "a", np.eye(4))], static=True)
    assert tree.find("map", "a", 0) is None


@pytest.mark.parametrize("size", [1e30, 1e200, float("inf")])
@pytest.mark.parametrize("static", [True, False])
def test_transforms_that_overflow_are_counted(size: float, *, static: bool) -> None:
    tree = TransformTree()
    far = np.eye(4)
    far[0, 3] = size
    stretched = stamped("b", "a", np.eye(4))
    stretched.transform.rotation = quaternion(size, size, 0.0, 1.0)
    assert tree.add([stamped("b", "a", far), stretched], static=static) == []
    assert tree.refused == 2
    assert isinstance(tree.last_refusal, BadInputError)
    assert tree.find("a", "b", 0) is None


def test_a_flood_of_frames_and_moments_is_bounded(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("locate.messages.transforms.MOST_KNOWN", 3)
    monkeypatch.setattr("locate.messages.transforms.MOST_POSES", 5)
    tree = TransformTree()
    for i in range(20):
        tree.add([stamped(f"frame_{i}", "map", np.eye(4))], static=bool(i % 2))
    assert tree.refused == 17
    assert tree.find("map", "frame_2", 0) is not None
    for stamp_ns in range(100):
        tree.add([stamped("frame_0", "map", np.eye(4), stamp_ns)], static=False)
    assert tree.refused == 17
    assert tree.find("map", "frame_0", 99) is not None
    assert tree.find("map", "frame_0", 94) is None


@pytest.mark.parametrize("covariance", [np.zeros(35), np.zeros(0)])
def test_a_covariance_of_another_size_is_refused(covariance: np.ndarray) -> None:
    with pytest.raises(BadInputError, match="expected 36"):
        tangent_covariance(np.eye(4), covariance)


def test_a_flood_of_poses_is_bounded() -> None:
    buffer = PoseBuffer(most=10)
    for stamp_ns in range(1000):
        buffer.add(
            StampedPose(
                stamp_ns=stamp_ns, world_from_cam=np.eye(4), covariance=np.full((6, 6), np.nan)
            )
        )
    assert len(buffer) == 10
    assert buffer.interpolate_at(999) is not None


@pytest.mark.parametrize("pose", [np.eye(4) * 1e200, np.diag([1.0, 1.0, 1.0, 1e300])])
def test_poses_that_overflow_are_refused(pose: np.ndarray) -> None:
    far = np.eye(4)
    far[1, 3] = -1e10
    for matrix in (pose, far):
        with pytest.raises(BadInputError, match="pose"):
            StampedPose(stamp_ns=0, world_from_cam=matrix, covariance=np.full((6, 6), np.nan))
    with pytest.raises(BadInputError, match="covariance"):
        StampedPose(stamp_ns=0, world_from_cam=np.eye(4), covariance=np.eye(6) * 1e200)
