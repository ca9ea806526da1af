"""The ROS 2 node: images, camera and poses in; markers, points, sources and diagnostics out."""

import importlib
from dataclasses import fields
from pathlib import Path
from typing import Any

from detect.detection import Detector
from geometry.errors import BadInputError
from locate.messages.wiring import Wiring
from locate.robot.control import COMMANDS, NodeControl
from locate.robot.message_adapter import MessageAdapter
from locate.robot.message_builder import MessageBuilder
from locate.robot.parameters import PARAMETERS, parameter_of
from locate.robot.publisher import (
    HEALTH_TOPIC,
    HEALTH_TYPE,
    MARKERS,
    POINTS,
    PlumePublisher,
    type_of,
)
from locate.robot.settings import LocatorSettings

NODE_NAME = "locate"
WARN_EVERY_S = 5.0
PUBLISH_S, DIAGNOSE_S = 0.1, 1.0
POSE_TOPICS = {
    "odometry": ("odometry", "nav_msgs/msg/Odometry"),
    "pose": ("pose", "geometry_msgs/msg/PoseWithCovarianceStamped"),
}


def ros_class(type_name: str) -> Any:
    """The rclpy class of a type such as ``"std_msgs/msg/Header"``."""
    package, kind, name = type_name.split("/")
    return getattr(importlib.import_module(f"{package}.{kind}"), name)


class LocateNode:
    """A node around a `Locator`.

    Args:
        node: The rclpy node; its parameters are declared here.
        detector: None takes that of the `Locator`.
    """

    def __init__(self, node: Any, *, detector: Detector | None = None) -> None:
        self.node = node
        self._declare()
        self._wiring = Wiring(**self._fields_of(Wiring))
        self.feeder = MessageAdapter(
            self._wiring,
            settings=LocatorSettings(**self._fields_of(LocatorSettings)),
            detector=detector,
            on_refusal=self._warn,
        )
        self._messages = MessageBuilder(
            ros_class, self._wiring.world_frame, octets=bytes, octet=lambda value: bytes([value])
        )
        self.announcer = PlumePublisher(self._messages, self._send)
        self.control = NodeControl(
            self.feeder,
            self.announcer,
            output=Path(str(self._parameter("output"))),
            running=bool(self._parameter("autostart")),
        )
        self._publishers: dict[str, Any] = {}
        self._subscribe()
        self._advertise()
        node.create_timer(PUBLISH_S, self._publish_news)
        node.create_timer(DIAGNOSE_S, self._diagnose)

    def close(self) -> None:
        """Ends the detector's thread."""
        self.feeder.close()

    def _declare(self) -> None:
        descriptor = ros_class("rcl_interfaces/msg/ParameterDescriptor")
        for name, (value, text) in PARAMETERS.items():
            self.node.declare_parameter(name, value, descriptor(description=text, read_only=True))

    def _parameter(self, name: str) -> Any:
        return self.node.get_parameter(name).value

    def _fields_of(self, kind: type[Wiring] | type[LocatorSettings]) -> dict[str, Any]:
        """The parameters that set the fields of a dataclass."""
        return {field.name: self._parameter(parameter_of(field.name)) for field in fields(kind)}

    def _warn(self, text: str) -> None:
        self.node.get_logger().warning(text, throttle_duration_sec=WARN_EVERY_S)

    def _subscribe(self) -> None:
        qos = importlib.import_module("rclpy.qos")
        sensor = qos.qos_profile_sensor_data
        listen = self.node.create_subscription
        compressed = self._parameter("image_transport") == "compressed"
        image = ros_class(f"sensor_msgs/msg/{'CompressedImage' if compressed else 'Image'}")
        name = "image/compressed" if compressed else "image"
        listen(image, name, self.control.while_running(self.feeder.image), sensor)
        listen(ros_class("sensor_msgs/msg/CameraInfo"), "camera_info", self.feeder.info, sensor)
        tf = ros_class("tf2_msgs/msg/TFMessage")
        listen(tf, "/tf", self.feeder.transforms, qos.QoSProfile(depth=100))
        listen(tf, "/tf_static", self.feeder.static_transforms, _latched(qos, depth=100))
        if self._wiring.pose_source != "tf":
            name, kind = POSE_TOPICS[self._wiring.pose_source]
            listen(ros_class(kind), name, self.control.while_running(self.feeder.body_pose), sensor)

    def _advertise(self) -> None:
        qos = importlib.import_module("rclpy.qos")
        self._latched = _latched(qos, depth=1)
        for name in (MARKERS, POINTS):
            self._publisher(name)
        self._diagnostics = self.node.create_publisher(ros_class(HEALTH_TYPE), HEALTH_TOPIC, 10)
        trigger = ros_class("std_srvs/srv/Trigger")
        for name in COMMANDS:
            self.node.create_service(
                trigger, f"~/{name}", lambda _ask, response, name=name: self._serve(name, response)
            )

    def _publish_news(self) -> None:
        if self.feeder.locator is not None:
            self.announcer.tell(self.feeder.locator.updates())

    def _send(self, name: str, message: Any, _stamp_ns: int) -> None:
        self._publisher(name).publish(message)

    def _publisher(self, name: str) -> Any:
        """The latched publisher of a topic below the node's name."""
        if name not in self._publishers:
            kind = ros_class(type_of(name))
            self._publishers[name] = self.node.create_publisher(kind, f"~/{name}", self._latched)
        return self._publishers[name]

    def _diagnose(self) -> None:
        name, now_ns = f"{self.node.get_name()}: plumes", self.node.get_clock().now().nanoseconds
        self._diagnostics.publish(self._messages.health(name, self.control.health(), now_ns))

    def _serve(self, name: str, response: Any) -> Any:
        """Answers a service that bears the name of a command."""
        answer = self.control.command(name, self.node.get_clock().now().nanoseconds)
        response.success, response.message = answer.success, answer.message
        return response


def _latched(qos: Any, *, depth: int) -> Any:
    return qos.QoSProfile(
        depth=depth,
        reliability=qos.ReliabilityPolicy.RELIABLE,
        durability=qos.DurabilityPolicy.TRANSIENT_LOCAL,
    )


def main(arguments: list[str] | None = None) -> None:
    """Runs the node until it is interrupted.

    Raises:
        BadInputError: There is no ROS 2 in this environment, or a parameter is out of range.
    """
    try:
        rclpy = importlib.import_module("rclpy")
        shutdown = importlib.import_module("rclpy.executors").ExternalShutdownException
    except ImportError as error:
        raise BadInputError(
            f"no ROS 2 here ({error}): source its setup.bash, then run again"
        ) from error
    rclpy.init(args=arguments)
    node = rclpy.create_node(NODE_NAME)
    locate_node = None
    try:
        locate_node = LocateNode(node)
        rclpy.spin(node)
    except (KeyboardInterrupt, shutdown):
        pass
    finally:
        if locate_node is not None:
            locate_node.close()
        node.destroy_node()
        rclpy.try_shutdown()
