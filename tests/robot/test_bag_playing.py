from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

pytest.importorskip("rosbags", reason="the extra `bag` is not installed")

from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from geometry.errors import BadInputError
from locate.fusion.views import Views
from locate.map.plume import PlumeMap
from locate.messages.bags import TopicChoice, is_bag
from locate.messages.stamps import NS_PER_S
from locate.messages.wiring import Wiring
from locate.robot import LocatorSettings
from locate.robot.bag_playing import locate_in_bag
from locate.simulation.evidence import ColumnTruth
from tests.robot.drive import Oracle, moments

UNDECIDED = LocatorSettings(lag=1, views_kept=16, null_draws=2, drift=False, views_a_decision=1000)
MOUNT = np.eye(4)
MOUNT[:3, :3] = [[0, 0, 1], [-1, 0, 0], [0, -1, 0]]
MOUNT[:3, 3] = [0.3, 0.0, 0.5]
SOME = 5
MCAP, SQLITE = StoragePlugin.MCAP, StoragePlugin.SQLITE3

Message = tuple[str, int, Any]


class MessageRecorder:
    """The messages of a drive, of ROS 2 or ROS 1."""

    def __init__(self, store: Stores) -> None:
        self.types = get_typestore(store)
        self.old = store is Stores.ROS1_NOETIC
        if self.old:
            transforms = "geometry_msgs/TransformStamped[] transforms"
            self.types.register(get_types_from_msg(transforms, "tf2_msgs/msg/TFMessage"))

    def make(self, name: str, **fields: Any) -> Any:
        return self.types.types[name](**fields)

    def header(self, stamp_ns: int, frame_id: str) -> Any:
        stamp = self.make(
            "builtin_interfaces/msg/Time", sec=stamp_ns // NS_PER_S, nanosec=stamp_ns % NS_PER_S
        )
        more = {"seq": 0} if self.old else {}
        return self.make("std_msgs/msg/Header", stamp=stamp, frame_id=frame_id, **more)

    def transform(self, child: str, parent: str, matrix: np.ndarray, stamp_ns: int) -> Any:
        x, y, z, w = Rotation.from_matrix(matrix[:3, :3]).as_quat()
        transform = self.make(
            "geometry_msgs/msg/Transform",
            translation=self.make(
                "geometry_msgs/msg/Vector3", **dict(zip("xyz", matrix[:3, 3], strict=True))
            ),
            rotation=self.make("geometry_msgs/msg/Quaternion", x=x, y=y, z=z, w=w),
        )
        one = self.make(
            "geometry_msgs/msg/TransformStamped",
            header=self.header(stamp_ns, parent),
            child_frame_id=child,
            transform=transform,
        )
        return self.make("tf2_msgs/msg/TFMessage", transforms=[one])

    def info(self, views: Views, stamp_ns: int) -> Any:
        camera = views.trajectory.camera
        region = self.make(
            "sensor_msgs/msg/RegionOfInterest",
            x_offset=0,
            y_offset=0,
            height=0,
            width=0,
            do_rectify=False,
        )
        matrices = {
            "d": np.zeros(5),
            "k": camera.matrix.ravel(),
            "r": np.eye(3).ravel(),
            "p": np.zeros(12),
        }
        if self.old:
            matrices = {name.upper(): value for name, value in matrices.items()}
        return self.make(
            "sensor_msgs/msg/CameraInfo",
            header=self.header(stamp_ns, "camera"),
            height=camera.height,
            width=camera.width,
            distortion_model="plumb_bob",
            binning_x=0,
            binning_y=0,
            roi=region,
            **matrices,
        )

    def image(self, views: Views, stamp_ns: int) -> Any:
        camera = views.trajectory.camera
        return self.make(
            "sensor_msgs/msg/Image",
            header=self.header(stamp_ns, "camera"),
            height=camera.height,
            width=camera.width,
            encoding="mono8",
            is_bigendian=0,
            step=camera.width,
            data=np.zeros(camera.width * camera.height, np.uint8),
        )

    def drive(self, views: Views) -> list[Message]:
        start_ns = 100 * NS_PER_S
        messages: list[Message] = [
            ("/tf_static", start_ns, self.transform("camera", "base_link", MOUNT, start_ns))
        ]
        for moment in moments(views, start_ns=start_ns):
            stamp_ns = moment.stamp_ns
            body = moment.world_from_cam @ np.linalg.inv(MOUNT)
            messages += [
                ("/camera/image_raw", stamp_ns, self.image(views, stamp_ns)),
                ("/camera/camera_info", stamp_ns, self.info(views, stamp_ns)),
                ("/tf", stamp_ns, self.transform("base_link", "map", body, stamp_ns)),
            ]
        return messages


def write_2(path: Path, views: Views, plugin: StoragePlugin) -> Path:
    recorder = MessageRecorder(Stores.ROS2_JAZZY)
    with Writer(path, version=9, storage_plugin=plugin) as writer:
        connections = {}
        for topic, time_ns, message in recorder.drive(views):
            if topic not in connections:
                connections[topic] = writer.add_connection(
                    topic, message.__msgtype__, typestore=recorder.types
                )
            data = recorder.types.serialize_cdr(message, message.__msgtype__)
            writer.write(connections[topic], time_ns, data)
    return path


def write_1(path: Path, views: Views) -> Path:
    recorder = MessageRecorder(Stores.ROS1_NOETIC)
    with Writer1(path) as writer:
        connections = {}
        for topic, time_ns, message in recorder.drive(views):
            if topic not in connections:
                connections[topic] = writer.add_connection(
                    topic, message.__msgtype__, typestore=recorder.types
                )
            data = recorder.types.serialize_ros1(message, message.__msgtype__)
            writer.write(connections[topic], time_ns, data)
    return path


KINDS: dict[str, Callable[[Path, Views], Path]] = {
    "mcap": lambda folder, views: write_2(folder / "bag", views, MCAP),
    "mcap file": lambda folder, views: write_2(folder / "bag", views, MCAP) / "bag.mcap",
    "sqlite": lambda folder, views: write_2(folder / "bag", views, StoragePlugin.SQLITE3),
    "db3 file": lambda folder, views: (
        write_2(folder / "bag", views, StoragePlugin.SQLITE3) / "bag.db3"
    ),
    "ros 1": lambda folder, views: write_1(folder / "drive.bag", views),
}


@pytest.fixture(scope="module")
def some(views: Views) -> Views:
    """The first few views: nothing to find, quick to play."""
    return Views(
        trajectory=views.trajectory.take(range(SOME)),
        llr=views.llr[:SOME],
        inverse_depth=views.inverse_depth[:SOME],
        displacement=views.displacement[:SOME],
        sigma_px=views.sigma_px[:SOME],
        correlation_px2=views.correlation_px2,
    )


@pytest.mark.parametrize("kind", KINDS)
def test_bags_of_every_kind_are_played(kind: str, some: Views, tmp_path: Path) -> None:
    path = KINDS[kind](tmp_path, some)
    assert is_bag(path)
    oracle = Oracle(some)
    locate_in_bag(
        path,
        tmp_path / "out",
        topics=TopicChoice(),
        wiring=Wiring(),
        settings=UNDECIDED,
        detector=oracle,
    )
    assert sorted(oracle.seen) == list(range(SOME))


def test_results_are_a_bag_that_other_readers_open(
    views: Views, truth: ColumnTruth, tmp_path: Path
) -> None:
    path = write_2(tmp_path / "bag", views, MCAP)
    output = tmp_path / "out"
    wiring = Wiring()
    for _ in range(2):
        plume_map = locate_in_bag(
            path,
            output,
            topics=TopicChoice(),
            wiring=wiring,
            settings=UNDECIDED,
            detector=Oracle(views),
        )
    (plume,) = plume_map.plumes
    assert PlumeMap.load(output / "map.json").plumes[0].source.tolist() == plume.source.tolist()

    reader = pytest.importorskip("mcap_ros2.reader", reason="mcap-ros2-support is not installed")
    received: dict[str, Any] = {}
    for message in reader.read_ros2_messages(str(output / "plumes" / "plumes.mcap")):
        received[message.channel.topic] = message.ros_msg
    assert set(received) == {"/locate/markers", "/locate/points", "/locate/leak_1"}
    place = received["/locate/leak_1"].pose.pose.position
    assert [place.x, place.y, place.z] == plume.source.tolist()
    assert len(received["/locate/markers"].markers) == 4
    cloud = received["/locate/points"]
    points = np.frombuffer(cloud.data, "<f4").reshape(cloud.width, -1)
    nearest = np.linalg.norm(points[:, :3] - plume.source, axis=1).min()
    assert nearest < plume.radius_by_height[:, 1].max() + abs(plume.extent_low) + 0.1


@pytest.mark.parametrize(
    ("topics", "part"),
    [
        (TopicChoice(image="/no"), "/camera/image_raw"),
        (TopicChoice(camera_info="/no"), "/camera/camera_info"),
        (TopicChoice(pose="/odom"), "holds no such topic"),
    ],
)
def test_topics_that_are_not_there_are_named(
    some: Views, tmp_path: Path, topics: TopicChoice, part: str
) -> None:
    path = write_2(tmp_path / "bag", some, MCAP)
    with pytest.raises(BadInputError, match=part):
        locate_in_bag(path, tmp_path / "out", topics=topics, wiring=Wiring())


def test_wrong_world_frame_is_explained(some: Views, tmp_path: Path) -> None:
    path = write_2(tmp_path / "bag", some, MCAP)
    wiring = Wiring(world_frame="earth")
    with pytest.raises(BadInputError, match="pose"):
        locate_in_bag(
            path, tmp_path / "out", topics=TopicChoice(), wiring=wiring, settings=UNDECIDED
        )


@pytest.mark.parametrize("name", ["broken.mcap", "broken.db3", "broken.bag", "missing.mcap"])
def test_what_is_no_bag_is_refused(tmp_path: Path, name: str) -> None:
    path = tmp_path / name
    if not name.startswith("missing"):
        path.write_bytes(b"no bag at all" * 100)
    with pytest.raises(BadInputError, match=name):
        locate_in_bag(path, tmp_path / "out", topics=TopicChoice(), wiring=Wiring())


def test_cut_recording_is_refused_or_played_so_far(some: Views, tmp_path: Path) -> None:
    path = write_2(tmp_path / "bag", some, MCAP) / "bag.mcap"
    data = path.read_bytes()
    path.write_bytes(data[: len(data) // 2])
    with pytest.raises(BadInputError, match=r"bag\.mcap"):
        locate_in_bag(
            path, tmp_path / "out", topics=TopicChoice(), wiring=Wiring(), settings=UNDECIDED
        )


def test_users_folder_is_not_overwritten(some: Views, tmp_path: Path) -> None:
    path = write_2(tmp_path / "bag", some, MCAP)
    (tmp_path / "out" / "plumes").mkdir(parents=True)
    wiring = Wiring()
    with pytest.raises(BadInputError, match="not a bag"):
        locate_in_bag(
            path,
            tmp_path / "out",
            topics=TopicChoice(),
            wiring=wiring,
            settings=UNDECIDED,
            detector=Oracle(some),
        )
