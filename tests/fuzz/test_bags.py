"""Whatever a bag holds: it is read, or refused in one clear line."""

import os
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("rosbags", reason="the extra `bag` is not installed")

from hypothesis import given
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores

from geometry.errors import BadInputError
from locate.messages.bags import TopicChoice
from locate.messages.image_stream import ImageStream
from locate.recording.bag import BagRecording
from tests.fuzz.bounds import impatient, read_bounded
from tests.fuzz.damage import Cut, cuts, damaged, fuzzed
from tests.fuzz.readers import CAMERA, check_camera, check_poses, texture
from tests.robot.test_bag_playing import MessageRecorder
from tests.robot.test_image_stream import IN_ORDER, coded, live

SECOND_NS = 1_000_000_000
KINDS = {
    "a.mcap": StoragePlugin.MCAP,
    "a.db3": StoragePlugin.SQLITE3,
    "a.bag": None,
}


def write(folder: Path, name: str) -> Path:
    """Three images, TF and a camera_info, in a bag of ROS 2 or ROS 1."""
    storage = KINDS[name]
    drive = MessageRecorder(Stores.ROS1_NOETIC if storage is None else Stores.ROS2_JAZZY)
    inside = folder / name if storage is None else folder / "bag"
    opened: Any = (
        Writer1(inside) if storage is None else Writer(inside, version=9, storage_plugin=storage)
    )
    with opened as writer:
        connections: dict[str, Any] = {}
        for i in range(3):
            stamp_ns = 100 * SECOND_NS + i * SECOND_NS // 10
            turn = np.eye(4)
            turn[0, 3] = i / 10
            messages = {
                "/tf": drive.transform("camera", "map", turn, stamp_ns),
                "/camera/image_raw": drive.make(
                    "sensor_msgs/msg/Image",
                    header=drive.header(stamp_ns, "camera"),
                    height=12,
                    width=16,
                    encoding="mono8",
                    is_bigendian=0,
                    step=16,
                    data=texture(i, (12, 16)).ravel(),
                ),
            }
            for topic, message in messages.items():
                kind = message.__msgtype__
                if topic not in connections:
                    connections[topic] = writer.add_connection(topic, kind, typestore=drive.types)
                serialize = drive.types.serialize_ros1 if drive.old else drive.types.serialize_cdr
                writer.write(connections[topic], stamp_ns, serialize(message, kind))
    return inside if storage is None else next(inside.glob(f"*{Path(name).suffix}"))


def read(path: Path) -> None:
    bag = BagRecording(path=path, topics=TopicChoice())
    for frame in bag.open_recording(max_side=64).frames():
        assert np.isfinite(frame.time_s)
    if bag.camera is not None:
        check_camera(bag.camera)
    poses = bag.poses(CAMERA)
    if poses is not None:
        check_poses(poses.trajectory)


@pytest.mark.parametrize("name", KINDS)
@fuzzed(30)
@given(found=cuts())
def test_damaged_bag(tmp_path: Path, name: str, found: list[Cut]) -> None:
    whole = tmp_path / "whole"
    if not whole.exists():
        whole.write_bytes(write(tmp_path, name).read_bytes())
    path = tmp_path / f"damaged{Path(name).suffix}"
    path.write_bytes(damaged(whole.read_bytes(), found))
    read_bounded(read, path)


@pytest.mark.parametrize("name", KINDS)
def test_a_pipe_is_not_waited_for(tmp_path: Path, name: str) -> None:
    bag = write(tmp_path, name)
    bag.unlink()
    os.mkfifo(bag)
    for path in {bag, bag.parent if bag.parent != tmp_path else bag}:
        with impatient(), pytest.raises(BadInputError, match="a pipe or a device"):
            read(path)


@pytest.mark.parametrize("name", KINDS)
def test_whole_bag(tmp_path: Path, name: str) -> None:
    read(write(tmp_path, name))


@pytest.mark.parametrize(
    ("name", "encoder", "options"),
    [
        ("h264", "libx264", IN_ORDER),
        ("h265", "libx265", {"x265-params": "log-level=none"}),
        ("vp9", "libvpx-vp9", {"lag-in-frames": "0", "b": "2000000"}),
    ],
)
@fuzzed(15)
@given(found=cuts())
def test_damaged_coded_video(
    tmp_path: Path, name: str, encoder: str, options: dict[str, str], found: list[Cut]
) -> None:
    path, whole = tmp_path / "damaged", tmp_path / "whole"
    if not whole.exists():
        (_, first), (_, second), *_ = coded(encoder, **options)
        whole.write_bytes(first)
        (tmp_path / "next").write_bytes(second)
    path.write_bytes(damaged(whole.read_bytes(), found))

    def decode(path: Path) -> None:
        stream = ImageStream()
        shown = stream.read(live(0, path.read_bytes(), name), 0)
        shown += stream.read(live(1, (tmp_path / "next").read_bytes(), name), 1)
        for picture in shown + stream.finish():
            assert picture.image.dtype == np.uint8

    read_bounded(decode, path)
