"""Publishes the plumes of a locator on the topics that every transport has."""

from collections.abc import Callable, Sequence
from typing import Any

from locate.robot.message_builder import MessageBuilder
from locate.robot.plume_tracks import PlumeUpdate, TrackState

MARKERS, POINTS = "markers", "points"
TYPES = {
    MARKERS: "visualization_msgs/msg/MarkerArray",
    POINTS: "sensor_msgs/msg/PointCloud2",
}
DIAGNOSTICS_TOPIC, DIAGNOSTICS_TYPE = "/diagnostics", "diagnostic_msgs/msg/DiagnosticArray"
LEAK_TYPE = "geometry_msgs/msg/PoseWithCovarianceStamped"

SendMessage = Callable[[str, Any, int], object]


def topic_type(name: str) -> str:
    """The message type of a topic by its name below the node's: markers, points or leak_N."""
    return TYPES.get(name, LEAK_TYPE)


class PlumePublisher:
    """Keeps the latest update of every plume, and publishes it.

    Args:
        messages: Builds the messages of the transport.
        send: Takes a topic's name below the node's, a message and its stamp, ns.

    Attributes:
        known: The latest update of every plume, by id.
    """

    def __init__(self, messages: MessageBuilder, send: SendMessage) -> None:
        self.known: dict[int, PlumeUpdate] = {}
        self._messages = messages
        self._send = send

    def publish_updates(self, updates: Sequence[PlumeUpdate]) -> None:
        """Publishes new updates, if there are any: all plumes again, and each confirmed leak."""
        if not updates:
            return
        latest = {update.plume.id: update for update in updates}
        self.known |= latest
        self.publish_all(max(update.stamp_ns for update in updates))
        for number, update in latest.items():
            if update.state == TrackState.CONFIRMED:
                self._send(
                    f"leak_{number}", self._messages.build_leak_pose(update), update.stamp_ns
                )

    def publish_all(self, stamp_ns: int) -> None:
        """Publishes all plumes again."""
        everything = [self.known[number] for number in sorted(self.known)]
        self._send(MARKERS, self._messages.build_markers(everything, stamp_ns), stamp_ns)
        self._send(POINTS, self._messages.build_point_cloud(everything, stamp_ns), stamp_ns)

    def clear_plumes(self, stamp_ns: int) -> None:
        """Forgets all plumes, and publishes that there are none."""
        self.known.clear()
        self.publish_all(stamp_ns)
