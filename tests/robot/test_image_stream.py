"""Coded video in the messages of a bag or a live robot: every picture with its own stamp."""

from fractions import Fraction
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import av
import numpy as np
import pytest

pytest.importorskip("rosbags", reason="the extra `bag` is not installed")

from rosbags.typesys import get_types_from_msg

from geometry.arrays import GreyImage
from geometry.errors import BadInputError
from locate.messages.image_stream import ImageStream
from tests.robot.test_bag_images import (
    COUNT,
    HEIGHT,
    START_NS,
    STEP_NS,
    WIDTH,
    ImageBag,
    images_of,
    refusal_of,
    scene,
)

FOXGLOVE = "foxglove_msgs/msg/CompressedVideo"
PACKET = "ffmpeg_image_transport_msgs/msg/FFMPEGPacket"
THEORA = "theora_image_transport/msg/Packet"
FIELDS = {
    FOXGLOVE: "builtin_interfaces/Time timestamp\nstring frame_id\nuint8[] data\nstring format",
    PACKET: "std_msgs/Header header\nint32 width\nint32 height\nstring encoding\nuint64 pts\n"
    "uint8 flags\nbool is_bigendian\nuint8[] data",
    THEORA: "std_msgs/Header header\nuint8[] data",
}
CODED = 6.0
"""Mean difference, in grey levels, of a picture coded with losses."""
IN_ORDER = {"tune": "zerolatency"}


def coded(encoder: str = "libx264", **options: str) -> list[tuple[int, bytes]]:
    """The number of the picture and the data of each message, in the order of coding."""
    context = av.CodecContext.create(encoder, "w")
    assert isinstance(context, av.VideoCodecContext)
    context.width, context.height, context.pix_fmt = WIDTH, HEIGHT, "yuv420p"
    context.time_base = Fraction(1, 10)
    context.options = {"crf": "12", **options}
    packets = []
    for i in range(COUNT):
        frame = av.VideoFrame.from_ndarray(scene(i), format="gray").reformat(format="yuv420p")
        frame.pts = i
        packets += context.encode(frame)
    packets += context.encode(None)
    return [(int(packet.pts or 0), bytes(packet)) for packet in packets]


def stamp(i: int) -> int:
    return START_NS + i * STEP_NS


def message(bag: ImageBag, kind: str, i: int, data: bytes, name: str = "h264") -> Any:
    samples = np.frombuffer(data, np.uint8)
    if kind not in bag.types.types and kind in FIELDS:
        bag.types.register(get_types_from_msg(FIELDS[kind], kind))
    header = bag.header(stamp(i), "camera")
    if kind == FOXGLOVE:
        return bag.make(kind, timestamp=header.stamp, frame_id="camera", data=samples, format=name)
    if kind == PACKET:
        more = {"width": WIDTH, "height": HEIGHT, "pts": i, "flags": 0, "is_bigendian": False}
        return bag.make(kind, header=header, encoding=name, data=samples, **more)
    return bag.compressed(data, name, stamp(i))


def live(i: int, data: bytes, name: str = "h264") -> Any:
    return SimpleNamespace(timestamp=None, frame_id="camera", data=data, format=name)


def error_of(image: GreyImage, i: int) -> float:
    return float(np.abs(image.astype(float) - scene(i)).mean())


@pytest.mark.parametrize("kind", [FOXGLOVE, PACKET, "sensor_msgs/msg/CompressedImage"])
@pytest.mark.parametrize("options", [IN_ORDER, {"bf": "2"}], ids=["in order", "B frames"])
def test_every_picture_has_the_stamp_of_its_message(
    tmp_path: Path, kind: str, options: dict[str, str]
) -> None:
    bag, packets = ImageBag(), coded(**options)
    name = "h264;yuv420p;bgr8;bgr8" if kind == PACKET else "h264"
    recording = bag.write(tmp_path, lambda i, _: message(bag, kind, *packets[i], name))
    opened = recording.open_recording(max_side=1280)
    frames = list(opened.frames())
    assert [int(frame.source) for frame in frames] == [stamp(i) for i in range(COUNT)]
    assert max(error_of(frame.image, i) for i, frame in enumerate(frames)) < CODED
    assert opened.warnings == []


@pytest.mark.parametrize(
    ("encoder", "name", "options"),
    [
        ("libx265", "H265", {"x265-params": "log-level=none"}),
        ("libvpx-vp9", "vp9", {"lag-in-frames": "0", "b": "2000000"}),
    ],
)
def test_other_codecs(encoder: str, name: str, options: dict[str, str]) -> None:
    stream = ImageStream()
    pictures = [
        picture
        for i, data in coded(encoder, **options)
        for picture in stream.read(live(i, data, name), i)
    ] + stream.finish()
    assert [picture.stamp_ns for picture in pictures] == list(range(COUNT))
    assert max(error_of(picture.image, picture.stamp_ns) for picture in pictures) < CODED
    assert stream.pictureless == 0


def test_a_live_stream_gives_each_picture_at_once() -> None:
    stream = ImageStream()
    for i, data in coded(**IN_ORDER):
        ((found, image),) = stream.read(live(i, data), i)
        assert found == i
        assert error_of(image, i) < CODED


def test_nothing_is_shown_before_the_first_key_frame(tmp_path: Path) -> None:
    bag, packets = ImageBag(), coded(**IN_ORDER, g="4")
    kept = packets[2:]
    recording = bag.write(
        tmp_path, lambda i, _: message(bag, FOXGLOVE, *kept[min(i, len(kept) - 1)])
    )
    opened = recording.open_recording(max_side=1280)
    frames = list(opened.frames())
    assert int(frames[0].source) == stamp(4)
    assert error_of(frames[0].image, 4) < CODED
    assert any("2 of 12 images cannot be read" in note for note in opened.warnings)


def test_pictures_after_a_damaged_one_wait_for_the_next_key_frame() -> None:
    stream, pictures, refused = ImageStream(), {}, 0
    for i, data in coded(**IN_ORDER, g="6"):
        try:
            shown = stream.read(live(i, data[: len(data) // 2] if i == 2 else data), i)
        except BadInputError:
            refused += 1
            continue
        pictures |= {picture.stamp_ns: picture.image for picture in shown}
    assert sorted(pictures) == [0, 1, *range(6, COUNT)]
    assert max(error_of(image, i) for i, image in pictures.items()) < CODED
    assert stream.pictureless + refused == 4


def test_gaps_in_coded_video_are_noted(tmp_path: Path) -> None:
    bag, packets = ImageBag(), coded(**IN_ORDER)
    del packets[5]
    recording = bag.write(tmp_path, lambda i, _: message(bag, FOXGLOVE, *packets[i % len(packets)]))
    _, notes = images_of(recording)
    assert any("1 gaps between the messages of its coded video" in note for note in notes)


def test_still_pictures_are_preferred_to_coded_video(tmp_path: Path) -> None:
    from rosbags.rosbag2 import StoragePlugin, Writer

    from locate.recording.bag import BagRecording

    bag, packets = ImageBag(), coded(**IN_ORDER)
    with Writer(tmp_path / "drive", version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        for i, data in packets:
            both = (message(bag, FOXGLOVE, i, data), bag.picture(scene(i), "mono8", stamp(i)))
            for name, one in zip(("/video", "/image"), both, strict=True):
                kind = one.__msgtype__
                if i == 0:
                    writer.add_connection(name, kind, typestore=bag.types)
                topic = next(c for c in writer.connections if c.topic == name)
                writer.write(topic, stamp(i), bag.types.serialize_cdr(one, kind))
    images, _ = images_of(BagRecording(path=tmp_path / "drive/drive.mcap"))
    np.testing.assert_array_equal(images[3], scene(3))


def test_theora_is_refused_by_name(tmp_path: Path) -> None:
    bag = ImageBag()
    bag.types.register(get_types_from_msg(FIELDS[THEORA], THEORA))
    data = np.zeros(20, np.uint8)
    recording = bag.write(
        tmp_path, lambda i, t: bag.make(THEORA, header=bag.header(t, "camera"), data=data)
    )
    assert "/camera/image: coded video whose messages do not name H.264" in refusal_of(recording)
