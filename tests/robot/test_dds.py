"""The node over DDS: with itself everywhere, and with real rclpy where there is one."""

import os
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("cyclonedds", reason="the extra `dds` is not installed")
pytest.importorskip("rosbags", reason="the extra `dds` is not installed")

from rosbags.typesys import Stores

from locate.fusion.views import Views
from locate.map.plume import PlumeMap
from locate.messages.wiring import Wiring
from locate.robot import LocatorSettings
from locate.robot.control import NodeControl
from locate.robot.dds import DdsNode, TopicNames
from locate.robot.dds_transport import DdsTransport
from locate.simulation.evidence import ColumnTruth
from tests.robot.drive import Oracle
from tests.robot.test_bag_playing import MessageRecorder

# What ROS itself warns of is not ours to repair.
pytestmark = pytest.mark.filterwarnings("ignore:module 'sre_:DeprecationWarning")

QUICK = LocatorSettings(lag=1, views_kept=16, null_draws=2, drift=False)
DOMAIN = 1 + os.getpid() % 100
"""Of this process alone: tests of another one beside it would be heard."""
IMAGE, INFO = "/camera/image_raw", "/camera/camera_info"
LATCHED_TOPICS = ("/tf_static", "/locate/markers", "/locate/points", "/locate/leak_1")
KINDS = {
    IMAGE: "sensor_msgs/msg/Image",
    INFO: "sensor_msgs/msg/CameraInfo",
    "/tf": "tf2_msgs/msg/TFMessage",
    "/tf_static": "tf2_msgs/msg/TFMessage",
    "/quiet/command": "std_msgs/msg/String",
}


class OverDds:
    """A robot whose own topics are on DDS, too."""

    def __init__(self, transport: DdsTransport) -> None:
        self._transport = transport
        self._senders = {topic: transport.advertise(topic, kind) for topic, kind in KINDS.items()}

    def send(self, topic: str, message: Any) -> None:
        self._senders[topic](message)

    def subscribe(self, topic: str, kind: str) -> list[Any]:
        received: list[Any] = []
        self._transport.subscribe(
            topic, kind, received.append, reliable=True, latched=topic in LATCHED_TOPICS
        )
        return received

    def spin_once(self) -> None:
        pass

    def close(self) -> None:
        pass


class OverRclpy:
    """A robot with ROS 2."""

    def __init__(self, transport: DdsTransport) -> None:
        import rclpy

        from locate.robot.ros2 import ros_class

        self._rclpy, self._types, self._class = rclpy, transport.types, ros_class
        rclpy.init(domain_id=DOMAIN)
        self._node = rclpy.create_node("robot")
        self._publishers = {
            topic: self._node.create_publisher(ros_class(kind), topic, self._qos(topic))
            for topic, kind in KINDS.items()
        }

    def _qos(self, topic: str) -> Any:
        from rclpy.qos import DurabilityPolicy, QoSProfile

        if topic in LATCHED_TOPICS:
            return QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        return QoSProfile(depth=100)

    def send(self, topic: str, message: Any) -> None:
        from rclpy.serialization import deserialize_message

        data = bytes(self._types.serialize_cdr(message, KINDS[topic]))
        self._publishers[topic].publish(deserialize_message(data, self._class(KINDS[topic])))

    def subscribe(self, topic: str, kind: str) -> list[Any]:
        received: list[Any] = []
        self._node.create_subscription(self._class(kind), topic, received.append, self._qos(topic))
        return received

    def spin_once(self) -> None:
        self._rclpy.spin_once(self._node, timeout_sec=0.01)

    def close(self) -> None:
        self._node.destroy_node()
        self._rclpy.shutdown()


Robot = OverDds | OverRclpy


@pytest.fixture(scope="module")
def transport() -> DdsTransport:
    return DdsTransport(DOMAIN)


@pytest.fixture(params=[OverDds, OverRclpy], ids=["cyclonedds", "rclpy"])
def robot(request: pytest.FixtureRequest, transport: DdsTransport) -> Iterator[Robot]:
    if request.param is OverRclpy and not os.environ.get("ROS_REQUIRED"):
        pytest.importorskip("rclpy", reason="no ROS 2 here; docs/robot.md says how to test it")
    robot = request.param(transport)
    yield robot
    robot.close()


@pytest.fixture
def node(transport: DdsTransport, views: Views) -> Iterator[DdsNode]:
    wiring = Wiring(pose_sigma_m=0.01, pose_sigma_deg=0.1)
    node = DdsNode(
        transport, wiring, TopicNames(image=IMAGE), detector=Oracle(views), settings=QUICK
    )
    yield node
    node.close()


@pytest.fixture
def blind_node(transport: DdsTransport, tmp_path: Path) -> Iterator[DdsNode]:
    """Its camera and its name are nobody else's."""
    topics = TopicNames(image=IMAGE, camera_info="/nobody/camera_info", out="/quiet")
    node = DdsNode(transport, Wiring(), topics, output=tmp_path, settings=QUICK)
    yield node
    node.close()


def spin(node: DdsNode, robot: Robot, done: Callable[[], object], timeout_s: float = 240) -> None:
    end = time.monotonic() + timeout_s
    while not done():
        assert time.monotonic() < end, "what was waited for never came"
        robot.spin_once()
        node.spin_once(0.02)


def until_it_comes(node: DdsNode, robot: Robot, topic: str, message: Any, came: Any) -> None:
    """Sends until it is received: discovery takes its time."""

    def sent() -> bool:
        robot.send(topic, message)
        return bool(came())

    spin(node, robot, sent)


def test_drive_ends_in_latched_markers_and_a_leak(
    robot: Robot, node: DdsNode, views: Views, truth: ColumnTruth
) -> None:
    drive = MessageRecorder(Stores.ROS2_JAZZY).drive(views)
    static = drive[0][2]
    until_it_comes(
        node,
        robot,
        "/tf_static",
        static,
        lambda: node.adapter.transform_tree.find("base_link", "camera", 0) is not None,
    )
    info = next(message for topic, _, message in drive if topic == INFO)
    until_it_comes(node, robot, INFO, info, lambda: node.adapter.locator)
    locator = node.adapter.locator
    assert locator is not None
    for topic, _, message in drive[1:]:
        before = locator.counts.images
        robot.send(topic, message)
        if topic == IMAGE:
            spin(node, robot, lambda before=before: locator.counts.images > before)
    spin(
        node,
        robot,
        lambda: any(u.state == "confirmed" for u in node.plume_publisher.known.values()),
    )

    late = robot.subscribe("/locate/markers", "visualization_msgs/msg/MarkerArray")
    leaks = robot.subscribe("/locate/leak_1", "geometry_msgs/msg/PoseWithCovarianceStamped")
    clouds = robot.subscribe("/locate/points", "sensor_msgs/msg/PointCloud2")
    spin(node, robot, lambda: late and leaks and clouds)
    assert {marker.ns for marker in late[-1].markers} == {"", "source", "axis", "label"}
    assert len(clouds[-1].data) == clouds[-1].width * clouds[-1].point_step > 0
    place = leaks[-1].pose.pose.position
    covariance = np.reshape(leaks[-1].pose.covariance, (6, 6))[:3, :3]
    error = np.array([place.x, place.y, place.z]) - truth.source
    assert error @ np.linalg.solve(covariance, error) < 16


def test_commands_are_answered_and_diagnostics_published(
    robot: Robot, blind_node: DdsNode, transport: DdsTransport, views: Views
) -> None:
    node = blind_node
    word = transport.types.types["std_msgs/msg/String"]
    answers = robot.subscribe("/quiet/answer", "std_msgs/msg/String")
    health = robot.subscribe("/diagnostics", "diagnostic_msgs/msg/DiagnosticArray")

    def answer_to(command: str) -> str:
        until_it_comes(
            node,
            robot,
            "/quiet/command",
            word(data=command),
            lambda: any(answer.data.startswith(command) for answer in answers),
        )
        return next(answer.data for answer in answers if answer.data.startswith(command))

    assert answer_to("dance") == "dance failed: 'dance' is none of start, stop, save, reset"
    assert answer_to("save") == "save failed: nothing to save: no camera_info yet"
    assert answer_to("stop") == "stop: stopped"
    image = MessageRecorder(Stores.ROS2_JAZZY).image(views, 0)
    until_it_comes(
        node,
        robot,
        IMAGE,
        image,
        lambda: node.control.report_health().values["ignored_while_stopped"],
    )
    spin(node, robot, lambda: any(array.status[0].message == "stopped" for array in health))
    assert health[-1].status[0].level in (1, b"\x01")
    assert answer_to("start") == "start: running"
    spin(node, robot, lambda: health[-1].status[0].message == "no camera_info yet")


def test_save_writes_the_map_and_reset_forgets_it(
    transport: DdsTransport, views: Views, tmp_path: Path
) -> None:
    node = DdsNode(transport, Wiring(), TopicNames(), output=tmp_path / "new", settings=QUICK)
    node.adapter.add_camera_info(MessageRecorder(Stores.ROS2_JAZZY).info(views, 0))
    answer = node.control.run_command("save", 0)
    assert answer.success
    assert PlumeMap.load(Path(answer.message)).plumes == ()
    (tmp_path / "file").touch()
    blocked = NodeControl(node.adapter, node.plume_publisher, output=tmp_path / "file" / "below")
    assert not blocked.run_command("save", 0).success
    assert node.control.run_command("reset", 0).message == "forgotten"
    node.close()


def test_image_that_cannot_be_read_is_counted(transport: DdsTransport, views: Views) -> None:
    node = DdsNode(transport, Wiring(), TopicNames(image="/bad/image_raw"), settings=QUICK)
    send = transport.advertise("/bad/image_raw", KINDS[IMAGE])
    message = MessageRecorder(Stores.ROS2_JAZZY).image(views, 0)
    message.encoding = "\udcff\udcff"
    with pytest.raises(UnicodeEncodeError):
        send(message)
    message.encoding = "nonsense"
    end = time.monotonic() + 30
    while not node.adapter.refusals["image"]:
        assert time.monotonic() < end
        send(message)
        node.spin_once(0.05)
    node.close()


def test_names_of_topics() -> None:
    assert TopicNames(image="/a/image_raw/compressed").camera_info_topic == "/a/camera_info"
    assert TopicNames(image="/a/image_raw").camera_info_topic == "/a/camera_info"
    assert TopicNames(image="/image").camera_info_topic == "/camera_info"
