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
    DIAGNOSTICS_TOPIC,
    DIAGNOSTICS_TYPE,
    MARKERS,
    POINTS,
    PlumePublisher,
    topic_type,
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
        pose: Of the type of the wiring's pose source; TF needs none.
        out: In front of the names of what is published.
    """

    image: str = "/image"
    camera_info: str = ""
    pose: str = "/odometry"
    out: str = "/locate"

    @property
    def camera_info_topic(self) -> str:
        """The topic of the camera."""
        camera = self.image.removesuffix("/compressed").rpartition("/")[0]
        return self.camera_info or f"{camera}/camera_info"


class DdsNode:
    """A `Locator` between the topics of a robot; `spin_once` does all the work.

    ROS 2's services need more of DDS than cyclonedds offers in Python: commands come as text on
    ``~/command``, and are answered on ``~/answer``.

    Args:
        transport: The robot's DDS.
        wiring: How the robot's frames hang together.
        names: Of the topics.
        settings: Of the `Locator`; None takes its defaults.
        detector: None takes that of the `Locator`.
        output: Folder that the command ``save`` writes map.json into.

    Attributes:
        adapter: What takes the robot's messages.
        plume_publisher: Publishes the plumes.
        control: Runs commands, and reports the node's health.
    """

    def __init__(
        self,
        transport: DdsTransport,
        wiring: Wiring,
        names: TopicNames,
        *,
        settings: LocatorSettings | None = None,
        detector: Detector | None = None,
        output: Path = OUTPUT,
    ) -> None:
        self._transport, self._out = transport, names.out
        self.adapter = MessageAdapter(wiring, settings=settings, detector=detector)
        self._senders = {
            name: transport.advertise(f"{names.out}/{name}", topic_type(name))
            for name in (MARKERS, POINTS)
        }
        self._messages = MessageBuilder(
            transport.types.types.__getitem__, wiring.world_frame, octets=lambda b: b
        )
        self.plume_publisher = PlumePublisher(self._messages, self._send_message)
        self.control = NodeControl(self.adapter, self.plume_publisher, output=output)
        self._send_diagnostics = transport.advertise(
            DIAGNOSTICS_TOPIC, DIAGNOSTICS_TYPE, latched=False
        )
        self._send_answer = transport.advertise(f"{names.out}/answer", STRING, latched=False)
        self._diagnosed_s = -DIAGNOSE_S
        self._subscribe_topics(wiring, names)

    def _subscribe_topics(self, wiring: Wiring, names: TopicNames) -> None:
        compressed = names.image.endswith("/compressed")
        image = f"sensor_msgs/msg/{'CompressedImage' if compressed else 'Image'}"
        subscribe, running = self._transport.subscribe, self.control.while_running
        subscribe(names.image, image, running(self.adapter.add_image))
        subscribe(
            names.camera_info_topic, "sensor_msgs/msg/CameraInfo", self.adapter.add_camera_info
        )
        subscribe("/tf", TF, self.adapter.add_transforms, reliable=True)
        subscribe("/tf_static", TF, self.adapter.add_static_transforms, latched=True)
        if wiring.pose_source != "tf":
            subscribe(
                names.pose, POSE_TYPES[wiring.pose_source], running(self.adapter.add_body_pose)
            )
        subscribe(f"{names.out}/command", STRING, self._run_command, reliable=True)

    def spin_once(self, timeout_s: float = 0.1) -> None:
        """Takes the messages that come within this time, and publishes updates."""
        self._transport.spin_once(timeout_s, self.adapter.count_refusal)
        if self.adapter.locator is not None:
            self.plume_publisher.publish_updates(self.adapter.locator.updates())
        if time.monotonic() - self._diagnosed_s >= DIAGNOSE_S:
            self._diagnosed_s = time.monotonic()
            name, health = f"{self._out.strip('/')}: plumes", self.control.report_health()
            self._send_diagnostics(self._messages.build_diagnostics(name, health, time.time_ns()))

    def close(self) -> None:
        """Ends the detector's thread."""
        self.adapter.close()

    def _run_command(self, message: Any) -> None:
        answer = self.control.run_command(message.data, time.time_ns())
        text = message.data if answer.success else f"{message.data} failed"
        self._send_answer(self._transport.types.types[STRING](data=f"{text}: {answer.message}"))

    def _send_message(self, name: str, message: Any, _stamp_ns: int) -> None:
        if name not in self._senders:
            self._senders[name] = self._transport.advertise(f"{self._out}/{name}", topic_type(name))
        self._senders[name](message)
