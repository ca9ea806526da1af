"""A robot's recording for `locate run`: its frames, its camera, and a pose for every frame."""

from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

from geometry.camera import Camera
from geometry.errors import BadInputError
from geometry.named_poses import NamedPoses
from locate.messages.bags import BagTopics, TopicChoice, open_bag
from locate.messages.camera_info import camera_from_info, is_calibrated
from locate.messages.codec import header_of
from locate.messages.poses import PoseBuffer, StampedPose, trajectory_from_poses
from locate.messages.stamps import NS_PER_S
from locate.messages.wiring import PoseResolver, Wiring
from locate.recording import Recording
from locate.recording.bag_images import BagImages
from locate.recording.depth import stretch_notes
from locate.recording.sizes import FrameSizes, SizeLimits

WAITING_NS = 10 * NS_PER_S
"""Images wait this long for a pose (chosen)."""


@dataclass(frozen=True, kw_only=True)
class BagRecording:
    """A bag, which can be read more than once; a frame's name is its stamp in ns.

    Attributes:
        path: The bag.
        topics: Those chosen; those that are missing are not used.
        wiring: How the robot's frames hang together.
    """

    path: Path
    topics: TopicChoice = field(default_factory=TopicChoice)
    wiring: Wiring = field(default_factory=Wiring)

    def open_recording(self, *, max_side: int, full_side: int | None = None) -> Recording:
        """The frames, as those of a video.

        Args:
            max_side: Longer images are reduced to this many px on the longest side.
            full_side: The same of what is kept at full size; None: `max_side`.

        Raises:
            BadInputError: It is no bag, or holds no images that can be read.
        """
        first, stretch = self._images.read_first(), self._images.stretch
        limits = SizeLimits(working=max_side, full=full_side or max_side)
        return Recording(
            path=self.path,
            photos=(),
            sizes=FrameSizes.of_image(self.path, first, limits),
            focal=None,
            stretch=stretch,
            warnings=stretch_notes(self.path, stretch),
            read=self._images.read,
        )

    @cached_property
    def camera(self) -> Camera | None:
        """By the first camera_info that is calibrated; None where there is none.

        Raises:
            BadInputError: Its lens is not understood.
        """
        with open_bag(self.path) as reader:
            topics = BagTopics(reader, self.path, self.topics, whole=False)
            for _, _, message in topics.read_messages(
                [topics.info] if topics.info else [], _skip_message
            ):
                if not is_calibrated(message, rectified=self.wiring.rectified):
                    continue
                try:
                    return camera_from_info(message, rectified=self.wiring.rectified)
                except BadInputError as error:
                    raise BadInputError(
                        f"{self.path}: {topics.info}: {error}; or give the camera with --camera"
                    ) from error
        return None

    def poses(self, camera: Camera | None) -> NamedPoses | None:
        """Where the camera was at each image that has a pose; None where no topic holds poses.

        Args:
            camera: That took them; None where it is not known.

        Raises:
            BadInputError: The topic holds no pose for any of them, or the
                camera is missing.
        """
        with open_bag(self.path) as reader:
            topics = BagTopics(reader, self.path, self.topics, whole=False)
            if topics.pose is None:
                return None
            if camera is None:
                raise BadInputError(f"{self.path}: holds poses and no camera_info; give --camera")
            search = _PoseSearch(topics.with_pose_source(self.wiring), self._images)
            found = {pose.stamp_ns: pose for pose in search.find_poses(topics)}
        if not found:
            why = search.refusal or f"TF does not lead from the images to {self.wiring.world_frame}"
            raise BadInputError(f"{self.path}: no image has a pose ({why}); see --pose-topic")
        poses = [found[stamp] for stamp in sorted(found)]
        return NamedPoses(
            trajectory=trajectory_from_poses(poses, range(len(poses)), camera),
            names=tuple(str(pose.stamp_ns) for pose in poses),
            path=self.path,
        )

    @cached_property
    def has_poses(self) -> bool:
        """Whether the bag holds poses: without them a map is in no frame of the robot's."""
        with open_bag(self.path) as reader:
            return BagTopics(reader, self.path, self.topics, whole=False).pose is not None

    @cached_property
    def _images(self) -> BagImages:
        return BagImages(self.path, self.topics)


class _PoseSearch:
    """Finds the poses of images while a bag is played."""

    def __init__(self, wiring: Wiring, images: BagImages) -> None:
        self.refusal = ""
        self._images = images
        self._pose_resolver = PoseResolver(wiring)
        self._poses = PoseBuffer()
        self._by_tf = wiring.pose_source == "tf"
        self._waiting: list[int] = []

    def find_poses(self, topics: BagTopics) -> Iterator[StampedPose]:
        transforms = topics.transform_topics
        for topic, _, message in topics.read_messages(
            [t for t in transforms if transforms[t]], _skip_message
        ):
            self._pose_resolver.tree.add(message.transforms, static=transforms[topic])
        poses = [] if self._by_tf or topics.pose is None else [topics.pose]
        for topic, time_ns, message in topics.read_messages(
            [topics.image, *transforms, *poses], _skip_message
        ):
            if topic == topics.image:
                self._pose_resolver.camera_frame = (
                    self._pose_resolver.camera_frame or header_of(message).frame_id
                )
                self._waiting.append(self._images.stamp_ns(message, time_ns))
            elif topic in transforms:
                self._pose_resolver.tree.add(message.transforms, static=transforms[topic])
            else:
                self._add_pose(message)
            yield from self._match_waiting()

    def _add_pose(self, message: Any) -> None:
        try:
            self._poses.add(self._pose_resolver.pose_from_message(message))
        except BadInputError as error:
            self.refusal = str(error)

    def _match_waiting(self) -> Iterator[StampedPose]:
        for stamp in list(self._waiting):
            pose = (
                self._pose_resolver.pose_from_tf(stamp)
                if self._by_tf
                else self._poses.interpolate_at(stamp)
            )
            if pose is not None:
                yield pose
            if pose is not None or stamp < self._waiting[-1] - WAITING_NS:
                self._waiting.remove(stamp)


def _skip_message(_what: str, _error: BadInputError) -> None:
    """Leaves out a message that cannot be decoded."""
