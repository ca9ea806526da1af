"""`locate run` on a robot's recording: the frames, the camera and the poses it works with."""

from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

pytest.importorskip("rosbags", reason="the extra `bag` is not installed")

from rosbags.highlevel import AnyReader
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores

from geometry.errors import BadInputError
from geometry.trajectory import Trajectory
from locate.map.plume import PlumeMap
from locate.messages.bags import TopicChoice
from locate.messages.codec import read_stamp_ns
from locate.messages.stamps import NS_PER_S
from locate.pipeline.config import RunConfig
from locate.pipeline.poses import frames_with_poses
from locate.pipeline.publish import _write_bag
from locate.pipeline.run import Run
from locate.recording import KeyFrames
from locate.recording.bag import BagRecording
from locate.simulation.evidence import orbit_trajectory
from tests.robot.test_bag_playing import MOUNT, MessageRecorder
from tests.robot.test_next_view import plume

COUNT, RATE_HZ = 12, 10
ODOMETRY = "nav_msgs/msg/Odometry"


@pytest.fixture(scope="module")
def trajectory() -> Trajectory:
    return orbit_trajectory(COUNT, 20)


def pattern(i: int) -> np.ndarray:
    """Texture that moves on by a pixel a frame: too little to contradict any poses."""
    texture = np.random.default_rng(0).integers(0, 256, (240, 480), dtype=np.uint8)
    return np.ascontiguousarray(texture[:, i : i + 320])


def stamp(i: int) -> int:
    return 100 * NS_PER_S + i * NS_PER_S // RATE_HZ


class Drive(MessageRecorder):
    """A bag of images, and of what says where the camera was."""

    def __init__(self) -> None:
        super().__init__(Stores.ROS2_JAZZY)

    def picture(self, i: int, **changes: Any) -> Any:
        fields = {
            "header": self.header(stamp(i), "camera"),
            "height": 240,
            "width": 320,
            "encoding": "mono8",
            "is_bigendian": 0,
            "step": 320,
            "data": pattern(i).ravel(),
        }
        return self.make("sensor_msgs/msg/Image", **{**fields, **changes})

    def odometry(self, world_from_cam: np.ndarray, stamp_ns: int) -> Any:
        body = world_from_cam @ np.linalg.inv(MOUNT)
        x, y, z, w = Rotation.from_matrix(body[:3, :3]).as_quat()
        make, zero = self.make, {"x": 0.0, "y": 0.0, "z": 0.0}
        place = make("geometry_msgs/msg/Point", **dict(zip("xyz", body[:3, 3], strict=True)))
        turn = make("geometry_msgs/msg/Quaternion", x=x, y=y, z=z, w=w)
        twist = make(
            "geometry_msgs/msg/Twist",
            linear=make("geometry_msgs/msg/Vector3", **zero),
            angular=make("geometry_msgs/msg/Vector3", **zero),
        )
        return make(
            ODOMETRY,
            header=self.header(stamp_ns, "odom"),
            child_frame_id="base_link",
            pose=make(
                "geometry_msgs/msg/PoseWithCovariance",
                pose=make("geometry_msgs/msg/Pose", position=place, orientation=turn),
                covariance=np.diag([1e-4] * 3 + [1e-6] * 3).ravel(),
            ),
            twist=make(
                "geometry_msgs/msg/TwistWithCovariance", twist=twist, covariance=np.zeros(36)
            ),
        )


def pose(trajectory: Trajectory, i: int) -> np.ndarray:
    matrix = np.eye(4)
    matrix[:3, :3] = trajectory.rotations[i].T
    matrix[:3, 3] = trajectory.centers_in_world[i]
    return matrix


def written(folder: Path, trajectory: Trajectory, *, poses: bool = True, info: bool = True) -> Path:
    """Images at 10 Hz, one of them broken; odometry at the same stamps, each after its image."""
    drive = Drive()
    path = folder / "drive"
    with Writer(path, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        connections: dict[str, Any] = {}

        def write(topic: str, time_ns: int, message: Any) -> None:
            kind = message.__msgtype__
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, kind, typestore=drive.types)
            writer.write(connections[topic], time_ns, drive.types.serialize_cdr(message, kind))

        write("/tf_static", stamp(0), drive.transform("camera", "base_link", MOUNT, stamp(0)))
        for i in range(COUNT):
            broken = {"encoding": "nonsense"} if i == 3 else {}
            write("/camera/image_raw", stamp(i), drive.picture(i, **broken))
            if info:
                write("/camera/camera_info", stamp(i), drive.info(_views(trajectory), stamp(i)))
            if poses:
                write("/odom", stamp(i) + 1, drive.odometry(pose(trajectory, i), stamp(i)))
    return path / "drive.mcap"


def _views(trajectory: Trajectory) -> Any:
    from types import SimpleNamespace

    return SimpleNamespace(trajectory=trajectory)


WITH_ODOMETRY = TopicChoice(pose="/odom")


def test_frames_are_the_images_that_can_be_read(trajectory: Trajectory, tmp_path: Path) -> None:
    bag = BagRecording(path=written(tmp_path, trajectory), topics=WITH_ODOMETRY)
    recording = bag.open_recording(max_side=1280)
    frames = list(recording.frames())
    assert len(frames) == COUNT - 1
    np.testing.assert_array_equal(frames[4].image, pattern(5))
    assert frames[4].time_s == pytest.approx(0.5)
    assert "nonsense" in recording.warnings[0]
    assert next(iter(bag.open_recording(max_side=160).frames())).image.shape == (120, 160)


def test_run_takes_camera_and_poses_of_the_bag(trajectory: Trajectory, tmp_path: Path) -> None:
    path = written(tmp_path, trajectory)
    run = Run(RunConfig(recording=path, pose_topic="/odom"), tmp_path / "out")
    run.prepare()
    found = frames_with_poses(run.files, KeyFrames.load(run.files.frame_index)).trajectory
    assert found is not None
    assert found.metric
    assert found.gravity
    assert found.camera.focal_px == pytest.approx(trajectory.camera.focal_px)
    rows = [round(RATE_HZ * time_s) for time_s in found.times_s]
    assert len(rows) >= 8
    assert 3 not in rows
    np.testing.assert_allclose(found.centers_in_world, trajectory.centers_in_world[rows], atol=1e-9)
    np.testing.assert_allclose(found.rotations, trajectory.rotations[rows], atol=1e-9)
    assert found.covariances is not None
    np.testing.assert_allclose(np.diag(found.covariances[0])[:3], 1e-6, rtol=1e-6)


@pytest.mark.parametrize("poses", [True, False])
def test_what_was_found_is_a_bag_in_the_world_of_the_poses(
    trajectory: Trajectory, tmp_path: Path, *, poses: bool
) -> None:
    config = RunConfig(
        recording=written(tmp_path, trajectory, poses=poses),
        pose_topic="/odom" if poses else None,
        world_frame="odom",
    )
    run = Run(config, tmp_path / "out")
    run.prepare(poses=False)
    key_frames = KeyFrames.load(run.files.frame_index)
    found = PlumeMap(units="m", gravity=True, detector="a", version="1", plumes=(plume(),))
    assert _write_bag(run.source, key_frames, found, tmp_path / "plumes") is poses
    assert (tmp_path / "plumes" / "plumes.mcap").is_file() is poses
    if not poses:
        return
    with AnyReader([tmp_path / "plumes"]) as reader:
        messages = {
            c.topic: reader.deserialize(data, c.msgtype) for c, _, data in reader.messages()
        }
    leak = messages[f"/locate/leak_{plume().id}"]
    assert leak.header.frame_id == "odom"
    assert read_stamp_ns(leak.header) == int(key_frames.frames[-1].source)
    assert leak.pose.pose.position.x == plume().source[0]
    assert len(messages["/locate/markers"].markers) > 1


def test_what_is_not_in_the_bag_is_done_without(trajectory: Trajectory, tmp_path: Path) -> None:
    bag = BagRecording(path=written(tmp_path, trajectory, poses=False, info=False))
    assert bag.camera is None
    assert bag.poses(trajectory.camera) is None


def test_a_lens_that_is_not_understood_is_no_missing_camera(
    trajectory: Trajectory, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    ideal = Drive.info

    def with_strange_lens(*args: Any) -> Any:
        return replace(ideal(*args), distortion_model="division", d=np.array([-0.1]))

    monkeypatch.setattr(Drive, "info", with_strange_lens)
    bag = BagRecording(path=written(tmp_path, trajectory))
    with pytest.raises(BadInputError, match=r"camera_info: .*'division'.*--camera"):
        assert bag.camera


def test_poses_are_nothing_without_a_camera(trajectory: Trajectory, tmp_path: Path) -> None:
    bag = BagRecording(path=written(tmp_path, trajectory, info=False))
    with pytest.raises(BadInputError, match="camera_info"):
        bag.poses(None)


@pytest.mark.parametrize(
    ("options", "part"),
    [
        ({"image_topic": "/no"}, "--image-topic /no: choose one of /camera/image_raw"),
        ({"pose_topic": "/no"}, "--pose-topic /no: choose one of /odom"),
        ({"pose_topic": "tf", "world_frame": "earth"}, "no image has a pose"),
    ],
)
def test_topics_that_are_not_there_are_named(
    trajectory: Trajectory, tmp_path: Path, options: dict[str, str], part: str
) -> None:
    path = written(tmp_path, trajectory)
    run = Run(RunConfig(recording=path, **options), tmp_path / "out")
    with pytest.raises(BadInputError, match=part):
        run.prepare()


def test_topic_of_something_that_is_no_bag(tmp_path: Path) -> None:
    with pytest.raises(BadInputError, match="leave --image-topic out"):
        Run(RunConfig(recording=tmp_path / "video.mp4", image_topic="/a"), tmp_path / "out")


@pytest.mark.parametrize("compression", ["none", "bz2", "lz4"])
def test_bags_that_debians_rosbag_wrote_are_read(compression: str) -> None:
    """The files are by python3-rosbag of Debian 12: a writer that nobody here wrote."""
    path = Path(__file__).parent / "data" / f"debian_{compression}.bag"
    bag = BagRecording(path=path)
    frames = list(bag.open_recording(max_side=1280).frames())
    assert [int(frame.image.mean()) for frame in frames] == [1, 11, 21, 31, 41, 51]
    assert bag.camera is not None
    assert bag.camera.focal_px == 28.0
    poses = bag.poses(bag.camera)
    assert poses is not None
    expected = [[0.0, 0.5 * i, 0.0] for i in range(6)]
    np.testing.assert_allclose(poses.trajectory.centers_in_world, expected, atol=1e-9)
    assert poses.names == tuple(frame.source for frame in frames)


@pytest.mark.parametrize("kept", [0.3, 0.6, 0.9])
@pytest.mark.parametrize("compression", ["none", "lz4", "bz2"])
def test_damaged_bags_are_refused_in_one_line(
    compression: str, kept: float, tmp_path: Path
) -> None:
    whole = (Path(__file__).parent / "data" / f"debian_{compression}.bag").read_bytes()
    cut, scratched = tmp_path / "cut.bag", tmp_path / "scratched.bag"
    at = int(kept * len(whole))
    cut.write_bytes(whole[:at])
    scratched.write_bytes(whole[:at] + bytes(64) + whole[at + 64 :])
    with pytest.raises(BadInputError, match=r"cut\.bag"):
        BagRecording(path=cut).open_recording(max_side=640)
    with suppress(BadInputError):  # what is scratched may be a picture
        BagRecording(path=scratched).open_recording(max_side=640)
