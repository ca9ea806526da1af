"""From a robot's messages to a `Locator`, whatever carried them."""

from collections import Counter, deque
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, Literal, get_args

import numpy as np

from detect.detection import Detector
from geometry.arrays import FloatArray
from geometry.camera import Camera
from geometry.errors import BadInputError
from locate.robot.codec import GreyReader, camera_from_info, stamp_ns
from locate.robot.locator import Locator
from locate.robot.poses import UNKNOWN
from locate.robot.settings import Settings
from locate.robot.transforms import (
    TransformTree,
    matrix_of,
    moved_covariance,
    tangent_covariance,
)

MOST_PENDING = 120

PoseSource = Literal["tf", "odometry", "pose"]


@dataclass(frozen=True, kw_only=True)
class Wiring:
    """How a robot's frames and poses hang together.

    Attributes:
        world_frame: Frame of the map, Z up.
        camera_frame: Optical frame of the camera; empty takes it from the images.
        body_frame: Frame whose pose comes in; empty takes the odometry's child frame, and for
            poses without one the camera itself.
        pose_source: Where poses come from.
        pose_sigma_m: Position sigma of poses that come without covariance, m; 0 is unknown.
        pose_sigma_deg: Their rotation sigma; 0 is unknown.
        rectified: The images are rectified.
        settings: Of the locator.

    Raises:
        BadInputError: The pose source is not known.
    """

    world_frame: str = "map"
    camera_frame: str = ""
    body_frame: str = ""
    pose_source: PoseSource = "tf"
    pose_sigma_m: float = 0.0
    pose_sigma_deg: float = 0.0
    rectified: bool = False
    settings: Settings = field(default_factory=Settings)

    def __post_init__(self) -> None:
        known = get_args(PoseSource)
        if self.pose_source not in known:
            raise BadInputError(f"pose_source is {self.pose_source!r}: use {', '.join(known)}")

    @property
    def stated_covariance(self) -> FloatArray:
        """(6, 6) of poses that come without one; NaN where it is unknown."""
        if self.pose_sigma_m <= 0 or self.pose_sigma_deg <= 0:
            return UNKNOWN
        sigmas = np.repeat([np.radians(self.pose_sigma_deg), self.pose_sigma_m], 3)
        return np.diag(sigmas**2)


class Feeder:
    """Feeds a `Locator`, which begins with the first camera_info; bad messages are counted.

    Args:
        wiring: How the robot's frames hang together.
        detector: None takes that of the `Locator`.
        threaded: As of the `Locator`.
        on_refusal: Told of each message that cannot be used.

    Attributes:
        locator: None before the first camera_info.
        camera: Likewise.
        refused: How many messages of each kind could not be used.
        last_refusal: Why the latest of them could not.
    """

    def __init__(
        self,
        wiring: Wiring,
        *,
        detector: Detector | None = None,
        threaded: bool = True,
        on_refusal: Callable[[str], object] = str,
    ) -> None:
        self.locator: Locator | None = None
        self.camera: Camera | None = None
        self.refused: Counter[str] = Counter()
        self.last_refusal = ""
        self.tree = TransformTree()
        self._wiring = wiring
        self._camera_frame = wiring.camera_frame
        self._detector = detector
        self._threaded = threaded
        self._on_refusal = on_refusal
        self._reader = GreyReader()
        self._pending: deque[int] = deque(maxlen=MOST_PENDING)

    def close(self) -> None:
        """Ends the detector's thread."""
        if self.locator is not None:
            self.locator.close()

    def reset(self) -> None:
        """Forgets every plume."""
        self._pending.clear()
        if self.locator is not None:
            self.locator.reset()

    def info(self, message: Any) -> None:
        """Takes a `CameraInfo`."""
        try:
            camera = camera_from_info(message, rectified=self._wiring.rectified)
        except BadInputError as error:
            self.refuse("camera_info", error)
            return
        if camera == self.camera:
            return
        self.camera = camera
        if self.locator is not None:
            self.locator.set_camera(camera)
        else:
            settings = self._wiring.settings
            self.locator = Locator(
                camera, settings=settings, detector=self._detector, threaded=self._threaded
            )

    def image(self, message: Any) -> None:
        """Takes an `Image` or a `CompressedImage`."""
        try:
            if self.locator is None:
                raise BadInputError("no camera_info yet")
            image, stamp = self._reader.read(message), stamp_ns(message.header)
            self._camera_frame = self._camera_frame or message.header.frame_id
            self.locator.feed_image(image, stamp)
        except BadInputError as error:
            self.refuse("image", error)
            return
        self._pending.append(stamp)
        self._pose_pending()

    def static_transforms(self, message: Any) -> None:
        """Takes a `TFMessage` that holds for ever."""
        self.tree.add(message.transforms, static=True)

    def transforms(self, message: Any) -> None:
        """Takes a `TFMessage`."""
        self.tree.add(message.transforms, static=False)
        self._pose_pending()

    def _pose_pending(self) -> None:
        """Looks up the poses of the images that wait for TF."""
        if self._wiring.pose_source != "tf" or self.locator is None:
            return
        for stamp in list(self._pending):
            pose = self.tree.find(self._wiring.world_frame, self._camera_frame, stamp)
            if pose is not None:
                self._pending.remove(stamp)
                self.locator.feed_pose(pose, self._wiring.stated_covariance, stamp)

    def body_pose(self, message: Any) -> None:
        """Takes an `Odometry`, a `PoseWithCovarianceStamped` or a `PoseStamped` of the body."""
        if self.locator is None:
            return
        stamp = stamp_ns(message.header)
        body = self._wiring.body_frame or getattr(message, "child_frame_id", "")
        bare = not hasattr(message.pose, "pose")
        pose = message.pose if bare else message.pose.pose
        try:
            world_from_body = matrix_of(pose.position, pose.orientation)
            mount = self.tree.find(body, self._camera_frame, stamp) if body else np.eye(4)
            if mount is None:
                raise BadInputError(f"TF does not say where {self._camera_frame!r} is in {body!r}")
            given = np.zeros(36) if bare else message.pose.covariance
            covariance = tangent_covariance(world_from_body, given)
            if np.isnan(covariance).any():
                covariance = self._wiring.stated_covariance
            moved = moved_covariance(mount, covariance)
            self.locator.feed_pose(world_from_body @ mount, moved, stamp)
        except BadInputError as error:
            self.refuse("pose", error)

    def refuse(self, what: str, error: BadInputError) -> None:
        """Counts a message that cannot be used."""
        self.refused[what] += 1
        self.last_refusal = f"{what}: {error}"
        self._on_refusal(self.last_refusal)

    def trouble(self) -> str:
        """The first thing that a person should look into; empty where there is none."""
        if self.locator is None:
            return self.last_refusal or "no camera_info yet"
        counts = self.locator.counts
        if counts.images == 0:
            return self.last_refusal or "no image yet"
        if not counts.key_frames:
            return self.last_refusal or "no pose comes at the times of the images"
        return ""
