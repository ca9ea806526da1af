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
    DIAGNOSTICS_TOPIC,
    DIAGNOSTICS_TYPE,
    MARKERS,
    POINTS,
    PlumePublisher,
    topic_type,
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
        self._declare_parameters()
        self._wiring = Wiring(**self._fields_of(Wiring))
        self.adapter = MessageAdapter(
            self._wiring,
            settings=LocatorSettings(**self._fields_of(LocatorSettings)),
            detector=detector,
            on_refusal=self._log_warning,
        )
        self._messages = MessageBuilder(
            ros_class, self._wiring.world_frame, octets=bytes, octet=lambda value: bytes([value])
        )
        self.plume_publisher = PlumePublisher(self._messages, self._publish_message)
        self.control = NodeControl(
            self.adapter,
            self.plume_publisher,
            output=Path(str(self._read_parameter("output"))),
            running=bool(self._read_parameter("autostart")),
        )
        self._publishers: dict[str, Any] = {}
        self._subscribe_topics()
        self._advertise_topics()
        node.create_timer(PUBLISH_S, self._publish_updates)
        node.create_timer(DIAGNOSE_S, self._publish_diagnostics)

    def close(self) -> None:
        """Ends the detector's thread."""
        self.adapter.close()

    def _declare_parameters(self) -> None:
        descriptor = ros_class("rcl_interfaces/msg/ParameterDescriptor")
        for name, (value, text) in PARAMETERS.items():
            self.node.declare_parameter(name, value, descriptor(description=text, read_only=True))

    def _read_parameter(self, name: str) -> Any:
        return self.node.get_parameter(name).value

    def _fields_of(self, kind: type[Wiring] | type[LocatorSettings]) -> dict[str, Any]:
        """The parameters that set the fields of a dataclass."""
        return {
            field.name: self._read_parameter(parameter_of(field.name)) for field in fields(kind)
        }

    def _log_warning(self, text: str) -> None:
        self.node.get_logger().warning(text, throttle_duration_sec=WARN_EVERY_S)

    def _subscribe_topics(self) -> None:
        qos = importlib.import_module("rclpy.qos")
        sensor = qos.qos_profile_sensor_data
        subscribe = self.node.create_subscription
        compressed = self._read_parameter("image_transport") == "compressed"
        image = ros_class(f"sensor_msgs/msg/{'CompressedImage' if compressed else 'Image'}")
        name = "image/compressed" if compressed else "image"
        subscribe(image, name, self.control.while_running(self.adapter.add_image), sensor)
        subscribe(
            ros_class("sensor_msgs/msg/CameraInfo"),
            "camera_info",
            self.adapter.add_camera_info,
            sensor,
        )
        tf = ros_class("tf2_msgs/msg/TFMessage")
        subscribe(tf, "/tf", self.adapter.add_transforms, qos.QoSProfile(depth=100))
        subscribe(
            tf, "/tf_static", self.adapter.add_static_transforms, _latched_qos(qos, depth=100)
        )
        if self._wiring.pose_source != "tf":
            name, kind = POSE_TOPICS[self._wiring.pose_source]
            subscribe(
                ros_class(kind),
                name,
                self.control.while_running(self.adapter.add_body_pose),
                sensor,
            )

    def _advertise_topics(self) -> None:
        qos = importlib.import_module("rclpy.qos")
        self._latched_profile = _latched_qos(qos, depth=1)
        for name in (MARKERS, POINTS):
            self._find_publisher(name)
        self._diagnostics = self.node.create_publisher(
            ros_class(DIAGNOSTICS_TYPE), DIAGNOSTICS_TOPIC, 10
        )
        trigger = ros_class("std_srvs/srv/Trigger")
        for name in COMMANDS:
            self.node.create_service(
                trigger,
                f"~/{name}",
                lambda _ask, response, name=name: self._serve_command(name, response),
            )

    def _publish_updates(self) -> None:
        if self.adapter.locator is not None:
            self.plume_publisher.publish_updates(self.adapter.locator.updates())

    def _publish_message(self, name: str, message: Any, _stamp_ns: int) -> None:
        self._find_publisher(name).publish(message)

    def _find_publisher(self, name: str) -> Any:
        """The latched publisher of a topic below the node's name."""
        if name not in self._publishers:
            kind = ros_class(topic_type(name))
            self._publishers[name] = self.node.create_publisher(
                kind, f"~/{name}", self._latched_profile
            )
        return self._publishers[name]

    def _publish_diagnostics(self) -> None:
        name, now_ns = f"{self.node.get_name()}: plumes", self.node.get_clock().now().nanoseconds
        self._diagnostics.publish(
            self._messages.build_diagnostics(name, self.control.report_health(), now_ns)
        )

    def _serve_command(self, name: str, response: Any) -> Any:
        """Answers a service that bears the name of a command."""
        answer = self.control.run_command(name, self.node.get_clock().now().nanoseconds)
        response.success, response.message = answer.success, answer.message
        return response


def _latched_qos(qos: Any, *, depth: int) -> Any:
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
