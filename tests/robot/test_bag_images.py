"""Images of bags: depth, clocks, encodings that are read, and refusals that name what to do."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

pytest.importorskip("rosbags", reason="the extra `bag` is not installed")

from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores

from geometry.errors import BadInputError
from locate.messages.codec import GreyReader
from locate.messages.stamps import NS_PER_S
from locate.recording.bag import BagRecording
from tests.robot.test_bag_playing import MessageRecorder

COUNT, HEIGHT, WIDTH = 12, 48, 64
START_NS = 1_700_000_000 * NS_PER_S
STEP_NS = NS_PER_S // 10
IMAGE, COMPRESSED = "sensor_msgs/msg/Image", "sensor_msgs/msg/CompressedImage"


def scene(i: int) -> np.ndarray:
    random = np.random.default_rng(0).random((HEIGHT, 2 * WIDTH))
    smooth = cv2.GaussianBlur(random, (0, 0), 2)
    smooth = (smooth - smooth.min()) / np.ptp(smooth)
    return np.asarray(np.rint(smooth[:, 3 * i : 3 * i + WIDTH] * 255).astype(np.uint8))


class ImageBag(MessageRecorder):
    """A bag with one topic of images."""

    def __init__(self) -> None:
        super().__init__(Stores.ROS2_JAZZY)

    def picture(self, image: np.ndarray, encoding: str, stamp_ns: int, **changes: Any) -> Any:
        data = np.frombuffer(image.tobytes(), np.uint8)
        fields = {
            "header": self.header(stamp_ns, "camera"),
            "height": image.shape[0],
            "width": image.shape[1],
            "encoding": encoding,
            "is_bigendian": 0,
            "step": len(data) // image.shape[0],
            "data": data,
        }
        return self.make(IMAGE, **{**fields, **changes})

    def compressed(self, data: bytes, name: str, stamp_ns: int) -> Any:
        header = self.header(stamp_ns, "camera")
        return self.make(COMPRESSED, header=header, format=name, data=np.frombuffer(data, np.uint8))

    def write(self, folder: Path, make: Callable[[int, int], Any]) -> BagRecording:
        path = folder / "drive"
        with Writer(path, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
            for i in range(COUNT):
                time_ns = START_NS + i * STEP_NS
                message = make(i, time_ns)
                kind = message.__msgtype__
                if i == 0:
                    topic = writer.add_connection("/camera/image", kind, typestore=self.types)
                writer.write(topic, time_ns, self.types.serialize_cdr(message, kind))
        return BagRecording(path=path / "drive.mcap")


def images_of(bag: BagRecording) -> tuple[list[np.ndarray], list[str]]:
    recording = bag.open_recording(max_side=1280)
    return [frame.image for frame in recording.frames()], recording.warnings


def refusal_of(bag: BagRecording) -> str:
    with pytest.raises(BadInputError) as caught:
        bag.open_recording(max_side=1280)
    assert "\n" not in str(caught.value)
    return str(caught.value)


@pytest.mark.parametrize("encoding", ["16UC1", "mono16"])
def test_centikelvin_images_keep_their_levels_on_one_scale(tmp_path: Path, encoding: str) -> None:
    bag = ImageBag()
    deep = [
        (29000 + 40 * i + 6 * scene(i).astype(np.uint16)).astype(np.uint16) for i in range(COUNT)
    ]
    images, notes = images_of(bag.write(tmp_path, lambda i, t: bag.picture(deep[i], encoding, t)))
    greys, values = np.stack(images).astype(float), np.stack(deep).astype(float)
    assert min(len(np.unique(image)) for image in images) > 130
    inside = (greys > 0) & (greys < 255)
    slope, offset = np.polyfit(values[inside], greys[inside], 1)
    assert np.abs(slope * values + offset - greys)[inside].max() < 1.0
    assert "samples of more than 8 bits" in notes[0]


def test_images_that_use_twelve_bits_keep_the_highest_eight(tmp_path: Path) -> None:
    bag = ImageBag()
    recording = bag.write(
        tmp_path, lambda i, t: bag.picture(scene(i).astype(np.uint16) * 16, "mono16", t)
    )
    images, _ = images_of(recording)
    for i, image in enumerate(images):
        np.testing.assert_array_equal(image, scene(i))


def test_images_that_are_not_wanted_are_not_decoded(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    bag = ImageBag()
    encodings = ["none" if i in (0, 4) else "mono8" for i in range(COUNT)]
    written = bag.write(tmp_path, lambda i, t: bag.picture(scene(i), encodings[i], t))
    read, decoded = GreyReader.read, []
    monkeypatch.setattr(GreyReader, "read", lambda *given: decoded.append(1) or read(*given))
    recording = written.open_recording(max_side=1280)
    every = list(recording.frames())
    assert [frame.index for frame in every] == [1, 2, 3, *range(5, COUNT)]
    assert every[0].time_s == 0
    assert any(f"2 of {COUNT} images cannot be read" in note for note in recording.warnings)
    decoded.clear()
    frames = list(recording.frames(lambda index, _: index in (3, 4, 7)))
    assert len(decoded) == 3
    assert [frame.source for frame in frames] == [every[2].source, every[5].source]
    for frame in frames:
        np.testing.assert_array_equal(frame.image, scene(frame.index))


@pytest.mark.parametrize("stamp_ns", [0, START_NS])
def test_images_without_stamps_have_the_times_of_recording(tmp_path: Path, stamp_ns: int) -> None:
    bag = ImageBag()
    recording = bag.write(tmp_path, lambda i, _: bag.picture(scene(i), "mono8", stamp_ns))
    opened = recording.open_recording(max_side=1280)
    frames = list(opened.frames())
    assert [frame.time_s for frame in frames] == pytest.approx([i / 10 for i in range(COUNT)])
    assert [frame.source for frame in frames][1] == str(START_NS + STEP_NS)
    assert any("times at which they were recorded" in note for note in opened.warnings)


def test_stamps_are_used_where_there_are_some_also_from_zero_on(tmp_path: Path) -> None:
    bag = ImageBag()
    recording = bag.write(tmp_path, lambda i, _: bag.picture(scene(i), "mono8", i * NS_PER_S))
    opened = recording.open_recording(max_side=1280)
    assert [frame.time_s for frame in opened.frames()] == list(range(COUNT))
    assert opened.warnings == []


@pytest.mark.parametrize(("encoding", "rows"), [("nv12", 24), ("nv21", 24), ("nv24", 96)])
@pytest.mark.parametrize("all_rows", [False, True])
def test_luma_planes_are_the_picture(
    tmp_path: Path, encoding: str, rows: int, all_rows: bool
) -> None:
    bag = ImageBag()

    def make(i: int, stamp_ns: int) -> Any:
        planes = np.vstack([scene(i), np.full((rows, WIDTH), 128, np.uint8)])
        height = len(planes) if all_rows else HEIGHT
        return bag.picture(planes, encoding, stamp_ns, height=height)

    images, notes = images_of(bag.write(tmp_path, make))
    for i, image in enumerate(images):
        np.testing.assert_array_equal(image, scene(i))
    assert notes == []


@pytest.mark.parametrize(
    ("encoding", "kind"), [("32FC1", np.float32), ("64FC1", np.float64), ("16SC1", np.int16)]
)
def test_real_numbers_are_shown_on_one_scale(
    tmp_path: Path, encoding: str, kind: type[np.generic]
) -> None:
    bag = ImageBag()
    kelvin = [scene(i) / (1 if encoding == "16SC1" else 17) - 20 + i / 10 for i in range(COUNT)]
    samples = [values.astype(kind) for values in kelvin]
    if encoding != "16SC1":
        samples[0][0] = np.nan
    images, notes = images_of(
        bag.write(tmp_path, lambda i, t: bag.picture(samples[i], encoding, t))
    )
    greys, values = np.stack(images)[:, 1:].astype(float), np.stack(samples)[:, 1:].astype(float)
    inside = (greys > 0) & (greys < 255)
    slope, offset = np.polyfit(values[inside], greys[inside], 1)
    assert np.abs(slope * values + offset - greys)[inside].max() < 1.0
    assert np.ptp(greys) > 200
    assert "samples are real numbers" in notes[0]


def test_images_without_any_number_show_nothing(tmp_path: Path) -> None:
    bag = ImageBag()
    empty = np.full((HEIGHT, WIDTH), np.nan, np.float32)
    images, _ = images_of(bag.write(tmp_path, lambda i, t: bag.picture(empty, "32FC1", t)))
    assert not np.any(images)


def test_unknown_encodings_are_refused_with_those_that_are_read(tmp_path: Path) -> None:
    bag = ImageBag()
    reason = refusal_of(bag.write(tmp_path, lambda i, t: bag.picture(scene(i), "mystery", t)))
    assert "'mystery' is not supported, only mono8, mono16" in reason


def test_coded_video_without_its_name_is_refused(tmp_path: Path) -> None:
    bag = ImageBag()
    data = b"\0\0\0\1\x67" + bytes(range(200))
    reason = refusal_of(bag.write(tmp_path, lambda _, t: bag.compressed(data, "jpeg", t)))
    assert "format 'jpeg': coded video" in reason
    assert "republish" in reason


def test_messages_that_are_no_video_are_refused_with_the_reason(tmp_path: Path) -> None:
    bag = ImageBag()
    data = bytes(range(200))
    reason = refusal_of(bag.write(tmp_path, lambda _, t: bag.compressed(data, "h264", t)))
    assert "12 of 12 images cannot be read: a message of coded video cannot be decoded" in reason


def test_images_that_are_left_out_are_counted_with_the_reason(tmp_path: Path) -> None:
    bag = ImageBag()
    recording = bag.write(
        tmp_path,
        lambda i, t: bag.picture(scene(i), "mystery" if i % 4 == 1 else "mono8", t),
    )
    images, notes = images_of(recording)
    assert len(images) == 9
    assert len(notes) == 1
    assert "3 of 12 images cannot be read: image encoding 'mystery'" in notes[0]
