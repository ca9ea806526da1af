"""The locator as a node of a ROS 2 robot on which nothing of ROS can be installed."""

import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from detect.detection import Detector
from locate.messages.wiring import Wiring
from locate.robot.control import NodeControl
from locate.robot.dds_transport import DdsTransport
from locate.robot.message_adapter import MessageAdapter
from locate.robot.message_builder import MessageBuilder
from locate.robot.publisher import (
    HEALTH_TOPIC,
    HEALTH_TYPE,
    MARKERS,
    POINTS,
    PlumePublisher,
    type_of,
)
from locate.robot.settings import LocatorSettings

POSE_TYPES = {
    "odometry": "nav_msgs/msg/Odometry",
    "pose": "geometry_msgs/msg/PoseWithCovarianceStamped",
}
TF = "tf2_msgs/msg/TFMessage"
STRING = "std_msgs/msg/String"
DIAGNOSE_S = 1.0
OUTPUT = Path("~/locate")


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

    ROS 2's services need more of DDS than cyclonedds gives to Python: commands come as words on
    ``~/command``, and are answered on ``~/answer``.

    Args:
        wire: The robot's DDS.
        wiring: How the robot's frames hang together.
        names: Of the topics.
        settings: Of the `Locator`; None takes its defaults.
        detector: None takes that of the `Locator`.
        output: Folder that the command ``save`` writes map.json into.

    Attributes:
        feeder: What takes the robot's messages.
        announcer: What tells of the plumes.
        control: The node's switches, and its health.
    """

    def __init__(
        self,
        wire: DdsTransport,
        wiring: Wiring,
        names: TopicNames,
        *,
        settings: LocatorSettings | None = None,
        detector: Detector | None = None,
        output: Path = OUTPUT,
    ) -> None:
        self._wire, self._out = wire, names.out
        self.feeder = MessageAdapter(wiring, settings=settings, detector=detector)
        self._senders = {
            name: wire.advertise(f"{names.out}/{name}", type_of(name)) for name in (MARKERS, POINTS)
        }
        self._messages = MessageBuilder(
            wire.types.types.__getitem__, wiring.world_frame, octets=lambda b: b
        )
        self.announcer = PlumePublisher(self._messages, self._send)
        self.control = NodeControl(self.feeder, self.announcer, output=output)
        self._diagnostics = wire.advertise(HEALTH_TOPIC, HEALTH_TYPE, latched=False)
        self._answer = wire.advertise(f"{names.out}/answer", STRING, latched=False)
        self._diagnosed_s = -DIAGNOSE_S
        self._listen(wiring, names)

    def _listen(self, wiring: Wiring, names: TopicNames) -> None:
        compressed = names.image.endswith("/compressed")
        image = f"sensor_msgs/msg/{'CompressedImage' if compressed else 'Image'}"
        listen, running = self._wire.listen, self.control.while_running
        listen(names.image, image, running(self.feeder.image))
        listen(names.beside, "sensor_msgs/msg/CameraInfo", self.feeder.info)
        listen("/tf", TF, self.feeder.transforms, reliable=True)
        listen("/tf_static", TF, self.feeder.static_transforms, latched=True)
        if wiring.pose_source != "tf":
            listen(names.pose, POSE_TYPES[wiring.pose_source], running(self.feeder.body_pose))
        listen(f"{names.out}/command", STRING, self._obey, reliable=True)

    def spin_once(self, timeout_s: float = 0.1) -> None:
        """Takes what comes within this time, and tells what has become known."""
        self._wire.spin_once(timeout_s, self.feeder.refuse)
        if self.feeder.locator is not None:
            self.announcer.tell(self.feeder.locator.updates())
        if time.monotonic() - self._diagnosed_s >= DIAGNOSE_S:
            self._diagnosed_s = time.monotonic()
            name, health = f"{self._out.strip('/')}: plumes", self.control.health()
            self._diagnostics(self._messages.health(name, health, time.time_ns()))

    def close(self) -> None:
        """Ends the detector's thread."""
        self.feeder.close()

    def _obey(self, message: Any) -> None:
        answer = self.control.command(message.data, time.time_ns())
        text = message.data if answer.success else f"{message.data} failed"
        self._answer(self._wire.types.types[STRING](data=f"{text}: {answer.message}"))

    def _send(self, name: str, message: Any, _stamp_ns: int) -> None:
        if name not in self._senders:
            self._senders[name] = self._wire.advertise(f"{self._out}/{name}", type_of(name))
        self._senders[name](message)
