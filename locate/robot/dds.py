"""The locator as a node of a ROS 2 robot on which nothing of ROS can be installed."""

from dataclasses import dataclass
from typing import Any

from detect.detection import Detector
from locate.robot.announcer import MARKERS, POINTS, Announcer, type_of
from locate.robot.feeder import Feeder
from locate.robot.messages import Messages
from locate.robot.wire import Wire
from locate.robot.wiring import Wiring

POSE_TYPES = {
    "odometry": "nav_msgs/msg/Odometry",
    "pose": "geometry_msgs/msg/PoseWithCovarianceStamped",
}
TF = "tf2_msgs/msg/TFMessage"


@dataclass(frozen=True, kw_only=True)
class TopicNames:
    """The robot's topics.

    Attributes:
        image: Of `Image`, or of `CompressedImage` where it ends with ``/compressed``.
        camera_info: Of `CameraInfo`; empty takes the one beside the images.
        pose: Of what the wiring's pose source says; TF needs none.
        out: In front of the names of what is published.
    """

    image: str = "/image"
    camera_info: str = ""
    pose: str = "/odometry"
    out: str = "/locate"

    @property
    def beside(self) -> str:
        """The topic of the camera."""
        camera = self.image.removesuffix("/compressed").rpartition("/")[0]
        return self.camera_info or f"{camera}/camera_info"


class DdsNode:
    """A `Locator` between the topics of a robot; `spin_once` does all the work.

    Args:
        wire: The robot's DDS.
        wiring: How the robot's frames hang together.
        names: Of the topics.
        detector: None takes that of the `Locator`.

    Attributes:
        feeder: What takes the robot's messages.
        announcer: What tells of the plumes.
    """

    def __init__(
        self,
        wire: Wire,
        wiring: Wiring,
        names: TopicNames,
        *,
        detector: Detector | None = None,
    ) -> None:
        self._wire = wire
        self.feeder = Feeder(wiring, detector=detector)
        compressed = names.image.endswith("/compressed")
        image = f"sensor_msgs/msg/{'CompressedImage' if compressed else 'Image'}"
        wire.listen(names.image, image, self.feeder.image)
        wire.listen(names.beside, "sensor_msgs/msg/CameraInfo", self.feeder.info)
        wire.listen("/tf", TF, self.feeder.transforms, reliable=True)
        wire.listen("/tf_static", TF, self.feeder.static_transforms, latched=True)
        if wiring.pose_source != "tf":
            wire.listen(names.pose, POSE_TYPES[wiring.pose_source], self.feeder.body_pose)
        self._out = names.out
        self._senders = {
            name: wire.advertise(f"{names.out}/{name}", type_of(name)) for name in (MARKERS, POINTS)
        }
        messages = Messages(wire.types.types.__getitem__, wiring.world_frame, octets=lambda b: b)
        self.announcer = Announcer(messages, self._send)

    def spin_once(self, timeout_s: float = 0.1) -> None:
        """Takes what comes within this time, and tells what has become known."""
        self._wire.spin_once(timeout_s, self.feeder.refuse)
        if self.feeder.locator is not None:
            self.announcer.tell(self.feeder.locator.updates())

    def close(self) -> None:
        """Ends the detector's thread."""
        self.feeder.close()

    def _send(self, name: str, message: Any, _stamp_ns: int) -> None:
        if name not in self._senders:
            self._senders[name] = self._wire.advertise(f"{self._out}/{name}", type_of(name))
        self._senders[name](message)
