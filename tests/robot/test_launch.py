"""The ROS package: what its launch file starts, its layouts, and a bag through its node."""

import json
import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import pytest
import yaml

from locate.fusion.views import Views
from locate.robot.parameters import PARAMETERS
from locate.robot.publisher import MARKERS, POINTS
from locate.robot.ros2 import NODE_NAME
from tests.robot.launch_stand_in import arguments_of, describe, started_by

# What ROS itself warns of is not ours to repair.
pytestmark = pytest.mark.filterwarnings("ignore:module 'sre_:DeprecationWarning")

PACKAGE = Path(__file__).parents[2] / "ros" / "locate_ros"
PUBLISHED = {f"/{NODE_NAME}/{name}" for name in (MARKERS, POINTS)}


@pytest.fixture(scope="module")
def launched() -> list[Any]:
    return describe(PACKAGE / "launch" / "locate.launch.py")


def test_the_node_alone_starts_where_nothing_else_is_asked_for(launched: list[Any]) -> None:
    (node,) = started_by(launched, image="/front/image", camera_info="/front/info")
    assert (node["package"], node["executable"], node["name"]) == (
        "locate_ros", "locate_node", NODE_NAME,
    )  # fmt: skip
    assert node["parameters"] == [str(PACKAGE / "config" / "locate.yaml")]
    assert dict(node["remappings"]) == {
        "image": "/front/image", "image/compressed": "/front/image/compressed",
        "camera_info": "/front/info", "odometry": "/odom", "pose": "/pose",
    }  # fmt: skip


def test_visualize_opens_rviz_with_the_layout(launched: list[Any]) -> None:
    _, rviz = started_by(launched, visualize="true", fixed_frame="odom")
    assert rviz["package"] == rviz["executable"] == "rviz2"
    assert rviz["arguments"] == ["-d", str(PACKAGE / "config" / "locate.rviz"), "-f", "odom"]
    assert rviz["parameters"] == [{"use_sim_time": "false"}]


def test_bagfile_is_played_with_its_clock(launched: list[Any]) -> None:
    _, play = started_by(launched, bagfile="/data/it's a drive.mcap")
    assert play["cmd"] == ["ros2", "bag", "play", "/data/it's a drive.mcap", "--clock"]
    _, rviz, _ = started_by(launched, bagfile="drive.mcap", visualize="true")
    assert rviz["parameters"] == [{"use_sim_time": "true"}]


def test_parameter_file_holds_parameters_of_the_node() -> None:
    (content,) = yaml.safe_load((PACKAGE / "config" / "locate.yaml").read_text()).values()
    for name, value in content["ros__parameters"].items():
        assert type(value) is type(PARAMETERS[name][0]), name


def test_rviz_listens_as_the_node_publishes() -> None:
    layout = yaml.safe_load((PACKAGE / "config" / "locate.rviz").read_text())
    topics = [one["Topic"] for one in layout["Visualization Manager"]["Displays"] if "Topic" in one]
    latched = {
        topic["Value"]
        for topic in topics
        if topic["Durability Policy"] == "Transient Local"
        and topic["Reliability Policy"] == "Reliable"
    }
    assert latched == PUBLISHED
    assert {topic["Value"] for topic in topics} - latched == {"image"}


def test_foxglove_shows_what_the_node_publishes(launched: list[Any]) -> None:
    layout = json.loads((PACKAGE / "config" / "foxglove.json").read_text())
    panels = layout["configById"]
    assert set(panels["3D!plumes"]["topics"]) == PUBLISHED
    image, defaults = panels["Image!camera"]["imageMode"], arguments_of(launched)
    assert image == {"imageTopic": defaults["image"], "calibrationTopic": defaults["camera_info"]}
    assert set(_leaves(layout["layout"])) == set(panels)


def _leaves(part: Any) -> list[str]:
    return [part] if isinstance(part, str) else [*_leaves(part["first"]), *_leaves(part["second"])]


def test_package_names_what_it_starts_its_licence_and_its_address() -> None:
    root = ElementTree.parse(PACKAGE / "package.xml").getroot()
    needed = {one.text for one in root.findall("exec_depend")}
    assert {"rclpy", "launch_ros", "rviz2", "ros2bag", "tf2_msgs"} <= needed
    assert root.findtext("license") == "Apache-2.0"
    assert {one.get("type") for one in root.findall("url")} == {
        "website", "repository", "bugtracker",
    }  # fmt: skip


def test_launch_file_and_layouts_are_installed(tmp_path: Path) -> None:
    source = shutil.copytree(PACKAGE, tmp_path / "locate_ros")
    subprocess.run(
        [sys.executable, "setup.py", "-q", "install_data", "--install-dir", tmp_path / "to"],
        cwd=source, check=True, capture_output=True,
    )  # fmt: skip
    share = tmp_path / "to" / "share" / "locate_ros"
    for folder in ("launch", "config"):
        shipped = {path.name for path in (PACKAGE / folder).iterdir() if path.is_file()}
        assert {path.name for path in (share / folder).iterdir()} == shipped


def test_package_is_valid_to_catkin_pkg() -> None:
    package = pytest.importorskip("catkin_pkg.package", reason="no ROS tools here")
    warnings: list[str] = []
    parsed = package.parse_package(str(PACKAGE), warnings=warnings)
    parsed.validate(warnings=warnings)
    assert warnings == []


def test_a_bag_reaches_the_node_that_is_launched(
    launched: list[Any], views: Views, tmp_path: Path
) -> None:
    """The node runs as the launch file says; a player in place of `ros2 bag play`."""
    if not os.environ.get("ROS_REQUIRED"):
        pytest.importorskip("rclpy", reason="no ROS 2 here; docs/robot.md says how to test it")
    import rclpy

    from tests.robot.test_bag_playing import MCAP, write_2

    bag = write_2(tmp_path / "drive", views, MCAP)
    node, play = started_by(launched, bagfile=str(bag))
    process = subprocess.Popen([sys.executable, "-c", RUN_NODE, *ros_arguments(node)])
    rclpy.init()
    try:
        watcher = rclpy.create_node("watcher")
        seen = DiagnosticsWatcher(watcher)
        seen.wait_for(lambda: seen.values is not None)
        play_bag(watcher, Path(play["cmd"][3]))
        seen.wait_for(lambda: int(seen.values.get("key_frames", 0)) > 0)
        assert {name: seen.values[name] for name in ("jumps", "misdated", "failures")} == {
            "jumps": "0", "misdated": "0", "failures": "0",
        }  # fmt: skip
    finally:
        process.send_signal(signal.SIGINT)  # as `ros2 launch` ends it
        process.wait(timeout=60)
        rclpy.shutdown()


RUN_NODE = "import sys; from locate.robot.ros2 import main; main(sys.argv[1:])"


def ros_arguments(node: dict[str, Any]) -> list[str]:
    """What `launch_ros` puts behind the executable of a node."""
    remappings = [("__node", node["name"]), *node["remappings"]]
    rules = [part for source, target in remappings for part in ("-r", f"{source}:={target}")]
    return ["--ros-args", *rules, "--params-file", *node["parameters"]]


class DiagnosticsWatcher:
    """The last values that the node reported of itself."""

    def __init__(self, node: Any) -> None:
        from diagnostic_msgs.msg import DiagnosticArray

        self.node = node
        self.values: dict[str, str] | None = None
        node.create_subscription(DiagnosticArray, "/diagnostics", self._take, 10)

    def _take(self, message: Any) -> None:
        self.values = {entry.key: entry.value for entry in message.status[0].values}

    def wait_for(self, happened: Any, timeout_s: float = 240.0) -> None:
        import rclpy

        end = time.monotonic() + timeout_s
        while not happened():
            assert time.monotonic() < end, f"what was waited for never came: {self.values}"
            rclpy.spin_once(self.node, timeout_sec=0.1)


def play_bag(node: Any, bag: Path) -> None:
    """Publishes the messages of a bag at the pace of their stamps."""
    from rclpy.qos import DurabilityPolicy, QoSProfile
    from rosbags.highlevel import AnyReader

    from locate.robot.ros2 import ros_class

    with AnyReader([bag]) as reader:
        publishers = {}
        for one in reader.connections:
            static = one.topic == "/tf_static"
            kept = DurabilityPolicy.TRANSIENT_LOCAL if static else DurabilityPolicy.VOLATILE
            profile = QoSProfile(depth=100, durability=kept)
            publishers[one.topic] = node.create_publisher(
                ros_class(one.msgtype), one.topic, profile
            )
        end = time.monotonic() + 60
        while any(one.get_subscription_count() == 0 for one in publishers.values()):
            assert time.monotonic() < end, "the node does not listen to the bag's topics"
            time.sleep(0.1)
        before_ns = None
        for connection, stamp_ns, content in reader.messages():
            if before_ns is not None:
                time.sleep((stamp_ns - before_ns) / 1e9)
            before_ns = stamp_ns
            publishers[connection.topic].publish(bytes(content))
