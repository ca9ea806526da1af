"""The ROS 2 node: images, camera and poses in; markers, points, sources and diagnostics out."""

import importlib
from collections.abc import Callable
from dataclasses import asdict, fields
from pathlib import Path
from typing import Any

from detect.detection import Detector
from geometry.errors import BadInputError
from locate.robot.announcer import MARKERS, POINTS, Announcer, type_of
from locate.robot.feeder import Feeder
from locate.robot.messages import Messages
from locate.robot.parameters import PARAMETERS
from locate.robot.settings import Settings
from locate.robot.tracks import State
from locate.robot.wiring import Wiring

NODE_NAME = "locate"
WARN_EVERY_S = 5.0
PUBLISH_S, DIAGNOSE_S = 0.1, 1.0
POSE_TOPICS = {
    "odometry": ("odometry", "nav_msgs/msg/Odometry"),
    "pose": ("pose", "geometry_msgs/msg/PoseWithCovarianceStamped"),
}
OK, WARN = b"\x00", b"\x01"


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
        self._wiring = self._wired()
        self.feeder = Feeder(self._wiring, detector=detector, on_refusal=self._warn)
        messages = Messages(ros_class, self._wiring.world_frame, octets=bytes)
        self.announcer = Announcer(messages, self._send)
        self._running = bool(self._parameter("autostart"))
        self._ignored = 0
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

    def _wired(self) -> Wiring:
        settings = {field.name: self._parameter(field.name) for field in fields(Settings)}
        wiring = {
            field.name: self._parameter(field.name)
            for field in fields(Wiring)
            if field.name != "settings"
        }
        return Wiring(**wiring, settings=Settings(**settings))

    def _warn(self, text: str) -> None:
        self.node.get_logger().warning(text, throttle_duration_sec=WARN_EVERY_S)

    def _subscribe(self) -> None:
        qos = importlib.import_module("rclpy.qos")
        sensor = qos.qos_profile_sensor_data
        listen = self.node.create_subscription
        compressed = self._parameter("image_transport") == "compressed"
        image = ros_class(f"sensor_msgs/msg/{'CompressedImage' if compressed else 'Image'}")
        name = "image/compressed" if compressed else "image"
        listen(image, name, self._while_running(self.feeder.image), sensor)
        listen(ros_class("sensor_msgs/msg/CameraInfo"), "camera_info", self.feeder.info, sensor)
        tf = ros_class("tf2_msgs/msg/TFMessage")
        listen(tf, "/tf", self.feeder.transforms, qos.QoSProfile(depth=100))
        listen(tf, "/tf_static", self.feeder.static_transforms, _latched(qos, depth=100))
        if self._wiring.pose_source != "tf":
            name, kind = POSE_TOPICS[self._wiring.pose_source]
            listen(ros_class(kind), name, self._while_running(self.feeder.body_pose), sensor)

    def _while_running(self, take: Callable[[Any], None]) -> Callable[[Any], None]:
        def taken(message: Any) -> None:
            if self._running:
                take(message)
            else:
                self._ignored += 1

        return taken

    def _advertise(self) -> None:
        qos = importlib.import_module("rclpy.qos")
        self._latched = _latched(qos, depth=1)
        for name in (MARKERS, POINTS):
            self._publisher(name)
        diagnostics = ros_class("diagnostic_msgs/msg/DiagnosticArray")
        self._diagnostics = self.node.create_publisher(diagnostics, "/diagnostics", 10)
        trigger = ros_class("std_srvs/srv/Trigger")
        for name in ("start", "stop", "save", "reset"):
            self.node.create_service(trigger, f"~/{name}", getattr(self, f"_{name}"))

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
        pair = ros_class("diagnostic_msgs/msg/KeyValue")
        locator = self.feeder.locator
        counts = {} if locator is None else asdict(locator.counts)
        counts |= {f"refused_{name}": count for name, count in self.feeder.refused.items()}
        counts["ignored_while_stopped"] = self._ignored
        counts["plumes"] = sum(u.state == State.CONFIRMED for u in self.announcer.known.values())
        trouble = self.feeder.trouble() if self._running else "stopped"
        status = ros_class("diagnostic_msgs/msg/DiagnosticStatus")(
            level=WARN if trouble else OK,
            name=f"{self.node.get_name()}: plumes",
            message=trouble or "looking",
            hardware_id="",
            values=[pair(key=name, value=str(count)) for name, count in counts.items()],
        )
        array = ros_class("diagnostic_msgs/msg/DiagnosticArray")()
        array.header.stamp = self.node.get_clock().now().to_msg()
        array.status = [status]
        self._diagnostics.publish(array)

    def _start(self, _request: Any, response: Any) -> Any:
        self._running = True
        return _answer(response, "looking")

    def _stop(self, _request: Any, response: Any) -> Any:
        self._running = False
        return _answer(response, "stopped")

    def _reset(self, _request: Any, response: Any) -> Any:
        self.feeder.reset()
        self.announcer.forget(self.node.get_clock().now().nanoseconds)
        return _answer(response, "forgotten")

    def _save(self, _request: Any, response: Any) -> Any:
        path = Path(str(self._parameter("output"))).expanduser() / "map.json"
        locator = self.feeder.locator
        if locator is None:
            return _answer(response, "nothing to save: no camera_info yet", success=False)
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            locator.plume_map().save(path)
        except OSError as error:
            return _answer(response, f"{path}: {error.strerror}", success=False)
        return _answer(response, str(path))


def _latched(qos: Any, *, depth: int) -> Any:
    return qos.QoSProfile(
        depth=depth,
        reliability=qos.ReliabilityPolicy.RELIABLE,
        durability=qos.DurabilityPolicy.TRANSIENT_LOCAL,
    )


def _answer(response: Any, message: str, *, success: bool = True) -> Any:
    response.success, response.message = success, message
    return response


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
