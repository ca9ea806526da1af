"""Recordings of robots (ROS 2 .mcap and .db3, ROS 1 .bag), opened, and their messages by topic."""

from collections.abc import Callable, Collection, Iterator, Sequence
from contextlib import closing, contextmanager, suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from geometry.errors import BadInputError
from geometry.regular_files import refuse_streams_within
from locate.messages.codec import VIDEO_ADVICE
from locate.messages.wiring import PoseSource, Wiring

if TYPE_CHECKING:
    from rosbags.highlevel import AnyReader
    from rosbags.interfaces import Connection

IMAGES = ("sensor_msgs/msg/Image", "sensor_msgs/msg/CompressedImage")
VIDEOS = (
    "foxglove_msgs/msg/CompressedVideo",
    "ffmpeg_image_transport_msgs/msg/FFMPEGPacket",
)
"""Topics of coded video, taken where there are no others."""
UNREAD_VIDEOS = ("theora_image_transport/msg/Packet",)
"""Topics of coded video that is not read."""
INFO = "sensor_msgs/msg/CameraInfo"
TF = "tf2_msgs/msg/TFMessage"
OLD_TF = "tf/msg/tfMessage"
POSE_SOURCES: dict[str, PoseSource] = {
    "nav_msgs/msg/Odometry": "odometry",
    "geometry_msgs/msg/PoseWithCovarianceStamped": "pose",
    "geometry_msgs/msg/PoseStamped": "pose",
}
BAG_SUFFIXES = (".bag", ".mcap", ".db3")


def is_bag(path: Path) -> bool:
    """True for a .bag, .mcap or .db3 file, and for a ROS 2 bag's folder."""
    return path.suffix in BAG_SUFFIXES or (path / "metadata.yaml").is_file()


@dataclass(frozen=True, kw_only=True)
class TopicChoice:
    """Which topics of a bag are used; None takes the only one that fits.

    Attributes:
        image: Of `Image`, `CompressedImage`, `CompressedVideo` or `FFMPEGPacket`.
        camera_info: Of `CameraInfo`; if there are several, the one beside the images.
        pose: Of `Odometry`, `PoseWithCovarianceStamped` or `PoseStamped`; ``"tf"`` takes TF.
    """

    image: str | None = None
    camera_info: str | None = None
    pose: str | None = None


@contextmanager
def open_bag(path: Path) -> Iterator["AnyReader"]:
    """The bag, opened.

    Raises:
        BadInputError: The extra `bag` is not installed, or it is no bag that can be read.
    """
    try:
        from rosbags.highlevel import AnyReader
        from rosbags.typesys import Stores, get_typestore
    except ImportError as error:
        raise BadInputError('bags need an extra: pip install "plume-locate[bag]"') from error
    refuse_streams_within(path)
    try:
        reader = AnyReader([path], default_typestore=get_typestore(Stores.LATEST))
        reader.open()
    except Exception as error:  # each storage and compression of a damaged bag has its own errors
        raise BadInputError(f"{path}: not a bag that can be read ({error})") from error
    with closing(reader):
        yield reader


class BagTopics:
    """The topics of an open bag that matter, and their messages.

    Args:
        reader: The bag.
        path: For messages.
        topics: Those chosen.
        whole: False accepts that there is no camera_info or no pose where none was chosen.

    Attributes:
        image: Its images.
        info: Its camera_info, or None.
        pose: Its poses; ``"tf"`` for TF; None where it has none.

    Raises:
        BadInputError: One is missing, or there are several to choose from.
    """

    def __init__(
        self, reader: "AnyReader", path: Path, topics: TopicChoice, *, whole: bool = True
    ) -> None:
        self._reader = reader
        self._path = path
        self._whole = whole
        self.image = self._choose_images(topics.image)
        beside = self.image.removesuffix("/compressed").rpartition("/")[0] + "/camera_info"
        near = beside if beside in reader.topics else None
        self.info = self._choose_optional(topics.camera_info or near, (INFO,), "--info-topic")
        moving = not all(self.transform_topics.values())
        by_tf = topics.pose == "tf" or (topics.pose is None and moving)
        self.pose = (
            "tf"
            if by_tf
            else self._choose_optional(topics.pose, tuple(POSE_SOURCES), "--pose-topic")
        )

    def _choose_topic(self, wanted: str | None, kinds: tuple[str, ...], option: str) -> str:
        fitting = self._topics_of(kinds)
        if wanted is not None and wanted in fitting:
            return wanted
        if wanted is None and len(fitting) == 1:
            return fitting[0]
        what = "holds no such topic" if not fitting else f"choose one of {', '.join(fitting)}"
        asked = "" if wanted is None else f" {wanted}"
        raise BadInputError(f"{self._path}: {option}{asked}: {what}")

    def _choose_images(self, wanted: str | None) -> str:
        pictures, videos = self._topics_of(IMAGES), self._topics_of(VIDEOS)
        unread = self._topics_of(UNREAD_VIDEOS)
        if wanted in unread or (unread and not pictures and not videos):
            raise BadInputError(f"{self._path}: {wanted or unread[0]}: {VIDEO_ADVICE}")
        is_coded = wanted in videos or not pictures
        kinds = VIDEOS if is_coded and videos else IMAGES
        return self._choose_topic(wanted, kinds, "--image-topic")

    def _choose_optional(
        self, wanted: str | None, kinds: tuple[str, ...], option: str
    ) -> str | None:
        if not self._whole and wanted is None and not self._topics_of(kinds):
            return None
        return self._choose_topic(wanted, kinds, option)

    def _topics_of(self, kinds: tuple[str, ...]) -> list[str]:
        return sorted({c.topic for c in self._reader.connections if c.msgtype in kinds})

    def with_pose_source(self, wiring: Wiring) -> Wiring:
        """The wiring with the pose source that the type of the pose topic implies."""
        if self.pose in (None, "tf"):
            return replace(wiring, pose_source="tf")
        kind = next(c.msgtype for c in self._reader.connections if c.topic == self.pose)
        return replace(wiring, pose_source=POSE_SOURCES[kind])

    @property
    def transform_topics(self) -> dict[str, bool]:
        """The topics of TF; True where their transforms hold for ever (``/tf_static``)."""
        return {
            c.topic: c.topic.endswith("tf_static")
            for c in self._reader.connections
            if c.msgtype in (TF, OLD_TF)
        }

    def read_messages(
        self, topics: Collection[str], refuse: Callable[[str, BadInputError], object]
    ) -> Iterator[tuple[str, int, Any]]:
        """Topic, time of recording (ns), and message, in order.

        Args:
            topics: Which.
            refuse: Called with each message that cannot be decoded: what it was, and why.
        """
        from rosbags.highlevel import AnyReaderError

        chosen = [c for c in self._reader.connections if c.topic in topics]
        if not chosen:
            return
        for connection, time_ns, data in self._read_stored(chosen):
            try:
                message = self._reader.deserialize(data, connection.msgtype)
            except AnyReaderError as error:
                refuse("message", BadInputError(f"{connection.topic}: {error}"))
                continue
            yield connection.topic, time_ns, message

    def sample_messages(self, topic: str, count: int) -> Iterator[Any]:
        """So many messages of a topic, at times spread over the bag; what is damaged is left out.

        Args:
            topic: Which.
            count: At most so many.
        """
        from rosbags.highlevel import AnyReaderError

        chosen = [c for c in self._reader.connections if c.topic == topic]
        start_ns, length_ns = self._reader.start_time, self._reader.duration
        starts = [start_ns + int(share * length_ns) for share in np.linspace(0, 1, count + 1)[:-1]]
        for start in starts if chosen else ():
            for connection, _, data in self._read_stored(chosen, start):
                with suppress(AnyReaderError):
                    yield self._reader.deserialize(data, connection.msgtype)
                break

    def share_played(self, time_ns: int) -> float:
        """Which share of the bag has been read at a time of recording."""
        return (time_ns - self._reader.start_time) / max(self._reader.duration, 1)

    def _read_stored(
        self, chosen: Sequence["Connection"], start_ns: int | None = None
    ) -> Iterator[tuple["Connection", int, bytes]]:
        try:
            yield from self._reader.messages(connections=chosen, start=start_ns)
        except Exception as error:  # as in `open_bag`
            raise BadInputError(f"{self._path}: damaged ({error})") from error
