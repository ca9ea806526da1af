"""Feeds a robot's messages to a `Locator`, whatever carried them."""

from collections import Counter, deque
from collections.abc import Callable
from typing import Any

from detect.detection import Detector
from geometry.camera import Camera
from geometry.errors import BadInputError
from locate.messages.camera_info import camera_from_info
from locate.messages.codec import header_of, read_stamp_ns
from locate.messages.image_stream import ImageStream
from locate.messages.transforms import TransformTree
from locate.messages.wiring import PoseResolver, Wiring
from locate.robot.locator import Locator
from locate.robot.settings import LocatorSettings

MOST_PENDING = 120
"""Images that wait for TF, at most (chosen)."""


class MessageAdapter:
    """Feeds a `Locator`, made at the first camera_info; messages it cannot use are counted.

    Args:
        wiring: How the robot's frames hang together.
        settings: Of the `Locator`; None takes its defaults.
        detector: None takes that of the `Locator`.
        threaded: As of the `Locator`.
        on_refusal: Called with the reason for each message that cannot be used.

    Attributes:
        locator: None before the first camera_info.
        camera: Likewise.
        refusals: How many messages of each kind could not be used.
        last_refusal: Why the latest of them could not.
    """

    def __init__(
        self,
        wiring: Wiring,
        *,
        settings: LocatorSettings | None = None,
        detector: Detector | None = None,
        threaded: bool = True,
        on_refusal: Callable[[str], object] = str,
    ) -> None:
        self.locator: Locator | None = None
        self.camera: Camera | None = None
        self.refusals: Counter[str] = Counter()
        self.last_refusal = ""
        self._wiring = wiring
        self._pose_resolver = PoseResolver(wiring)
        self._settings = settings
        self._detector = detector
        self._threaded = threaded
        self._on_refusal = on_refusal
        self._images = ImageStream()
        self._pending: deque[int] = deque(maxlen=MOST_PENDING)

    @property
    def transform_tree(self) -> TransformTree:
        """The transforms that TF has sent."""
        return self._pose_resolver.tree

    def close(self) -> None:
        """Ends the detector's thread."""
        if self.locator is not None:
            self.locator.close()

    def reset(self) -> None:
        """Forgets every plume."""
        self._pending.clear()
        if self.locator is not None:
            self.locator.reset()

    def add_camera_info(self, message: Any) -> None:
        """Takes a `CameraInfo`."""
        try:
            camera = camera_from_info(message, rectified=self._wiring.rectified)
        except BadInputError as error:
            self.count_refusal("camera_info", error)
            return
        if camera == self.camera:
            return
        self.camera = camera
        if self.locator is not None:
            self.locator.set_camera(camera)
        else:
            self.locator = Locator(
                camera,
                settings=self._settings,
                detector=self._detector,
                threaded=self._threaded,
            )

    def add_image(self, message: Any) -> None:
        """Takes an `Image`, a `CompressedImage` or a message of coded video."""
        try:
            if self.locator is None:
                raise BadInputError("no camera_info yet")
            header = header_of(message)
            self._pose_resolver.camera_frame = self._pose_resolver.camera_frame or header.frame_id
            for stamp, image in self._images.read(message, read_stamp_ns(header)):
                self.locator.feed_image(image, stamp)
                self._pending.append(stamp)
        except BadInputError as error:
            self.count_refusal("image", error)
            return
        self._find_waiting_poses()

    def add_static_transforms(self, message: Any) -> None:
        """Takes a `TFMessage` of ``/tf_static``: it holds for ever."""
        self._add_to_tree(message, static=True)

    def add_transforms(self, message: Any) -> None:
        """Takes a `TFMessage`."""
        self._add_to_tree(message, static=False)
        self._find_waiting_poses()

    def _add_to_tree(self, message: Any, *, static: bool) -> None:
        before = self.transform_tree.refused
        self.transform_tree.add(message.transforms, static=static)
        refusal = self.transform_tree.last_refusal
        if refusal is not None and self.transform_tree.refused > before:
            self.count_refusal("tf", refusal)

    def _find_waiting_poses(self) -> None:
        """Looks up the poses of the images that wait for TF."""
        if self._wiring.pose_source != "tf" or self.locator is None:
            return
        for stamp in list(self._pending):
            try:
                pose = self._pose_resolver.pose_from_tf(stamp)
            except BadInputError as error:
                self._pending.remove(stamp)
                self.count_refusal("pose", error)
                continue
            if pose is not None:
                self._pending.remove(stamp)
                self.locator.feed_pose(pose.world_from_cam, pose.covariance, stamp)

    def add_body_pose(self, message: Any) -> None:
        """Takes an `Odometry`, a `PoseWithCovarianceStamped` or a `PoseStamped` of the body."""
        if self.locator is None:
            return
        try:
            pose = self._pose_resolver.pose_from_message(message)
            self.locator.feed_pose(pose.world_from_cam, pose.covariance, pose.stamp_ns)
        except BadInputError as error:
            self.count_refusal("pose", error)

    def count_refusal(self, what: str, error: BadInputError) -> None:
        """Counts a message that cannot be used."""
        self.refusals[what] += 1
        self.last_refusal = f"{what}: {error}"
        self._on_refusal(self.last_refusal)

    def find_problem(self) -> str:
        """The first problem that a person should solve; empty where there is none."""
        if self.locator is None:
            return self.last_refusal or "no camera_info yet"
        counts = self.locator.counts
        if counts.images == 0:
            return self.last_refusal or "no image yet"
        if not counts.key_frames:
            return self.last_refusal or "no pose comes at the times of the images"
        return ""
