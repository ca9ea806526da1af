"""The node against a real ROS 2, in an environment of its own (ROS_REQUIRED=1: do not skip)."""

import importlib
import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from locate.fusion.views import Views
from locate.messages.stamps import NS_PER_S
from locate.messages.transforms import ros_covariance
from locate.simulation.evidence import ColumnTruth
from tests.robot.drive import Moment, Oracle, moments

os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
if os.environ.get("ROS_REQUIRED"):
    import rclpy
else:
    rclpy = pytest.importorskip("rclpy", reason="no ROS 2 here; docs/robot.md says how to test it")

from rclpy.executors import SingleThreadedExecutor
from rclpy.parameter import Parameter
from rclpy.qos import DurabilityPolicy, QoSProfile

from locate.robot.ros2 import LocateNode, ros_class

# What ROS itself warns of is not ours to repair.
pytestmark = pytest.mark.filterwarnings("ignore:module 'sre_:DeprecationWarning")

MOUNT = np.eye(4)
MOUNT[:3, :3] = [[0, 0, 1], [-1, 0, 0], [0, -1, 0]]
MOUNT[:3, 3] = [0.3, 0.0, 0.5]
LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
QUICK = {
    "lag": 1,
    "views_kept": 16,
    "null_draws": 2,
    "drift": False,
    "pose_sigma_m": 0.01,
    "pose_sigma_deg": 0.1,
}


class Robot:
    """A robot's side of the topics, and the node under test, in one executor."""

    def __init__(self, views: Views, **parameters: Any) -> None:
        self.views = views
        rclpy.init()
        self.executor = SingleThreadedExecutor()
        overrides = [
            Parameter(name, value=value) for name, value in {**QUICK, **parameters}.items()
        ]
        node = rclpy.create_node("locate", parameter_overrides=overrides)
        self.locate = LocateNode(node, detector=Oracle(views))
        self.node = rclpy.create_node("robot")
        self.executor.add_node(node)
        self.executor.add_node(self.node)
        publish = self.node.create_publisher
        self.image = publish(ros_class("sensor_msgs/msg/Image"), "image", 10)
        self.info = publish(ros_class("sensor_msgs/msg/CameraInfo"), "camera_info", 10)
        self.tf = publish(ros_class("tf2_msgs/msg/TFMessage"), "/tf", 100)
        self.tf_static = publish(ros_class("tf2_msgs/msg/TFMessage"), "/tf_static", LATCHED)
        self.odometry = publish(ros_class("nav_msgs/msg/Odometry"), "odometry", 10)
        self.send_transform(self.tf_static, "camera", "base_link", MOUNT, 0)
        self.spin(lambda: self.image.get_subscription_count() > 0)
        self.spin(
            lambda: self.locate.adapter.transform_tree.find("base_link", "camera", 0) is not None
        )

    def close(self) -> None:
        self.locate.close()
        self.executor.shutdown()
        self.locate.node.destroy_node()
        self.node.destroy_node()
        rclpy.shutdown()

    def spin(self, done: Callable[[], object], timeout_s: float = 240.0) -> None:
        end = time.monotonic() + timeout_s
        while not done():
            assert time.monotonic() < end, "what was waited for never came"
            self.executor.spin_once(timeout_sec=0.02)

    def header(self, stamp_ns: int, frame_id: str) -> Any:
        stamp = ros_class("builtin_interfaces/msg/Time")(
            sec=stamp_ns // NS_PER_S, nanosec=stamp_ns % NS_PER_S
        )
        return ros_class("std_msgs/msg/Header")(stamp=stamp, frame_id=frame_id)

    def send_info(self, **changes: Any) -> None:
        camera = self.views.trajectory.camera
        fields = {
            "width": camera.width,
            "height": camera.height,
            "k": camera.matrix.ravel(),
            "distortion_model": "plumb_bob",
        }
        message = ros_class("sensor_msgs/msg/CameraInfo")(**{**fields, **changes})
        before = self.locate.adapter.camera
        self.info.publish(message)
        self.spin(lambda: self.locate.adapter.camera not in (None, before))

    def image_message(self, stamp_ns: int, **changes: Any) -> Any:
        camera = self.views.trajectory.camera
        fields = {
            "header": self.header(stamp_ns, "camera"),
            "width": camera.width,
            "height": camera.height,
            "encoding": "mono8",
            "step": camera.width,
            "data": bytes(camera.width * camera.height),
        }
        return ros_class("sensor_msgs/msg/Image")(**{**fields, **changes})

    def send_transform(
        self, publisher: Any, child: str, parent: str, matrix: np.ndarray, stamp_ns: int
    ) -> None:
        message = ros_class("geometry_msgs/msg/TransformStamped")(
            header=self.header(stamp_ns, parent), child_frame_id=child
        )
        translation, rotation = message.transform.translation, message.transform.rotation
        translation.x, translation.y, translation.z = map(float, matrix[:3, 3])
        x, y, z, w = map(float, Rotation.from_matrix(matrix[:3, :3]).as_quat())
        rotation.x, rotation.y, rotation.z, rotation.w = x, y, z, w
        publisher.publish(ros_class("tf2_msgs/msg/TFMessage")(transforms=[message]))

    def send_odometry(self, moment: Moment) -> None:
        body = moment.world_from_cam @ np.linalg.inv(MOUNT)
        message = ros_class("nav_msgs/msg/Odometry")(
            header=self.header(moment.stamp_ns, "odom"), child_frame_id="base_link"
        )
        pose = message.pose.pose
        pose.position.x, pose.position.y, pose.position.z = map(float, body[:3, 3])
        x, y, z, w = map(float, Rotation.from_matrix(body[:3, :3]).as_quat())
        pose.orientation.x, pose.orientation.y = x, y
        pose.orientation.z, pose.orientation.w = z, w
        message.pose.covariance = ros_covariance(body, np.diag([1e-6] * 3 + [1e-4] * 3))
        self.odometry.publish(message)

    def drive(self, *, start_ns: int = 100 * NS_PER_S) -> None:
        """Images and TF of the whole drive, each taken in before the next is sent."""
        for moment in moments(self.views, start_ns=start_ns):
            body = moment.world_from_cam @ np.linalg.inv(MOUNT)
            fed = self.counts.images
            self.image.publish(self.image_message(moment.stamp_ns))
            self.send_transform(self.tf, "base_link", "map", body, moment.stamp_ns)
            self.spin(lambda fed=fed: self.counts.images > fed)
        self.spin(lambda: not self.locator._selector._images)
        self.spin(
            lambda: (
                self.locator._selector.window.waiting_count <= 1
                and not (self.locator._detecting or self.locator._deciding)
            )
        )

    @property
    def working(self) -> bool:
        return bool(
            self.locator._detecting or self.locator._deciding or self.locator._engine.decision_due
        )

    @property
    def locator(self) -> Any:
        return self.locate.adapter.locator

    @property
    def counts(self) -> Any:
        return self.locator.counts

    def subscribe(self, type_name: str, topic: str, qos: Any = LATCHED) -> list[Any]:
        received: list[Any] = []
        self.node.create_subscription(ros_class(type_name), topic, received.append, qos)
        return received

    def call(self, name: str) -> Any:
        client = self.node.create_client(ros_class("std_srvs/srv/Trigger"), f"/locate/{name}")
        self.spin(client.service_is_ready)
        future = client.call_async(ros_class("std_srvs/srv/Trigger").Request())
        self.spin(future.done)
        return future.result()


@pytest.fixture
def robot(views: Views) -> Iterator[Robot]:
    robot = Robot(views)
    try:
        yield robot
    finally:
        robot.close()


def test_drive_ends_in_latched_markers_and_a_leak(
    robot: Robot, truth: ColumnTruth, tmp_path: Path
) -> None:
    diagnostics = robot.subscribe("diagnostic_msgs/msg/DiagnosticArray", "/diagnostics", 10)
    robot.send_info()
    robot.drive()
    robot.spin(
        lambda: any(u.state == "confirmed" for u in robot.locate.plume_publisher.known.values())
    )

    late = robot.subscribe("visualization_msgs/msg/MarkerArray", "/locate/markers")
    robot.spin(lambda: late)
    kinds = {marker.ns for marker in late[-1].markers}
    assert kinds == {"", "source", "axis", "label"}
    assert late[-1].markers[0].action == 3
    assert all(marker.header.frame_id == "map" for marker in late[-1].markers)

    leaks = robot.subscribe("geometry_msgs/msg/PoseWithCovarianceStamped", "/locate/leak_1")
    robot.spin(lambda: leaks)
    place = leaks[-1].pose.pose.position
    covariance = np.reshape(leaks[-1].pose.covariance, (6, 6))[:3, :3]
    error = np.array([place.x, place.y, place.z]) - truth.source
    assert error @ np.linalg.solve(covariance, error) < 16

    clouds = robot.subscribe("sensor_msgs/msg/PointCloud2", "/locate/points")
    robot.spin(lambda: clouds)
    assert len(clouds[-1].data) == clouds[-1].width * clouds[-1].point_step > 0

    robot.spin(lambda: any("running" in d.status[0].message for d in diagnostics))
    values = {pair.key: pair.value for pair in diagnostics[-1].status[0].values}
    assert int(values["images"]) == 12
    assert int(values["dropped"]) == 0

    saved = robot.call("save")
    assert saved.success
    content = json.loads(Path(saved.message).read_text())
    assert len(content["plumes"]) == 1

    assert robot.call("reset").success
    assert robot.locator.plume_map().plumes == ()
    robot.spin(lambda: len(late[-1].markers) == 1)


@pytest.fixture(autouse=True)
def _home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("HOME", str(tmp_path))


def test_odometry_and_the_mounting_give_the_cameras_pose(views: Views) -> None:
    robot = Robot(views, pose_source="odometry", world_frame="odom")
    try:
        robot.send_info()
        every = list(moments(views))
        robot.image.publish(robot.image_message(every[0].stamp_ns))
        robot.spin(lambda: robot.counts.images == 1)
        robot.send_odometry(every[0])
        robot.spin(lambda: len(robot.locator._selector.window) == 1)
        pose = robot.locator._selector.window._keys[0].pose
        np.testing.assert_allclose(pose.world_from_cam, every[0].world_from_cam, atol=1e-9)
        sigmas = np.sqrt(np.diag(pose.covariance))
        np.testing.assert_allclose(sigmas[:3], 1e-3, rtol=1e-6)
        assert (sigmas[3:] > 0.01 - 1e-9).all()
    finally:
        robot.close()


def test_padding_and_byte_order_survive_the_transport(robot: Robot) -> None:
    robot.send_info()
    samples = np.random.default_rng(0).integers(0, 1 << 16, (240, 320), dtype=np.uint16)
    rows = samples.astype(">u2").view(np.uint8).reshape(240, 640)
    data = np.concatenate([rows, np.full((240, 11), 0xA5, np.uint8)], axis=1)
    message = robot.image_message(
        NS_PER_S, encoding="mono16", is_bigendian=1, step=651, data=data.tobytes()
    )
    robot.image.publish(message)
    robot.spin(lambda: robot.counts.images == 1)
    np.testing.assert_array_equal(robot.locator._selector._images[NS_PER_S], samples >> 8)


def test_thousand_malformed_images_are_counted_and_survived(robot: Robot) -> None:
    robot.send_info()
    rng = np.random.default_rng(0)
    for i in range(1000):
        faults = [
            {"encoding": "nonsense"},
            {"step": int(rng.integers(0, 320))},
            {"data": rng.bytes(int(rng.integers(0, 1000)))},
            {"width": 0},
            {"height": 1 << 31},
            {"width": 100, "step": 320},
        ]
        fault = faults[i % len(faults)]
        refused = robot.locate.adapter.refusals["image"]
        robot.image.publish(robot.image_message(i, **fault))
        robot.spin(lambda refused=refused: robot.locate.adapter.refusals["image"] > refused)
    assert robot.locate.adapter.refusals["image"] == 1000
    robot.drive()
    assert robot.counts.looked_at >= 11


def test_pose_stream_that_stops_and_camera_that_changes(robot: Robot) -> None:
    robot.send_info()
    for i in range(90):
        fed = robot.counts.images
        robot.image.publish(robot.image_message(NS_PER_S + i * NS_PER_S // 30))
        robot.spin(lambda fed=fed: robot.counts.images > fed)
    assert robot.counts.unposed >= 58
    assert len(robot.locator._selector._images) <= 60
    robot.drive()
    looked_at = robot.counts.looked_at
    matrix = robot.views.trajectory.camera.matrix.copy()
    matrix[0, 0] *= 1.01
    robot.send_info(k=matrix.ravel())
    robot.drive(start_ns=200 * NS_PER_S)
    assert robot.counts.looked_at >= looked_at + 11
    assert robot.counts.failures == 0


def test_stop_and_start(robot: Robot) -> None:
    robot.send_info()
    assert robot.call("stop").success
    for i in range(5):
        robot.image.publish(robot.image_message(NS_PER_S + i))
    robot.spin(lambda: robot.locate.control.report_health().values["ignored_while_stopped"] == 5)
    assert robot.call("start").success
    assert robot.counts.images == 0
    robot.image.publish(robot.image_message(2 * NS_PER_S))
    robot.spin(lambda: robot.counts.images == 1)


@pytest.mark.slow
def test_pause_of_ten_seconds(robot: Robot) -> None:
    robot.send_info()
    robot.drive()
    end = time.monotonic() + 10
    robot.spin(lambda: time.monotonic() > end)
    looked_at = robot.counts.looked_at
    robot.drive(start_ns=112 * NS_PER_S)
    assert robot.counts.looked_at >= looked_at + 11


def test_command_ends_on_interrupt(tmp_path: Path) -> None:
    parameters = Path(__file__).parents[2] / "ros" / "locate_ros" / "config" / "locate.yaml"
    code = "import sys; from locate.robot.ros2 import main; main(sys.argv[1:])"
    process = subprocess.Popen(
        [sys.executable, "-c", code, "--ros-args", "--params-file", str(parameters)],
        stderr=subprocess.PIPE,
        text=True,
    )
    rclpy.init()
    try:
        node = rclpy.create_node("watcher")
        end = time.monotonic() + 60
        while "locate" not in node.get_node_names():
            assert time.monotonic() < end
            time.sleep(0.1)
        time.sleep(1)
        process.send_signal(signal.SIGINT)
        _, errors = process.communicate(timeout=30)
        assert process.returncode == 0
        assert "Traceback" not in errors
    finally:
        process.kill()
        rclpy.shutdown()


def test_every_parameter_is_described(robot: Robot) -> None:
    node = robot.locate.node
    for name in importlib.import_module("locate.robot.parameters").PARAMETERS:
        assert len(node.describe_parameter(name).description) > 10
