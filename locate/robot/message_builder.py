"""Plumes as ROS messages, built with whichever classes a transport has."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from geometry.arrays import FloatArray
from locate.map.plume import Plume
from locate.messages.stamps import NS_PER_S
from locate.robot.plume_tracks import PlumeUpdate, TrackState

MARKED_SIGMAS = 2.0
"""Half axes of a source's ellipsoid, in sigmas."""
LEAST_MARK_M = 0.02
"""Smallest axis of a marker that can still be seen (chosen)."""
UNKNOWN_VARIANCE = 1e6
"""Of a leak's orientation, rad squared: messages have no other way to call it unknown."""
AROUND, UPWARDS = 24, 16
"""Points of an outline: on a ring, and rings."""
SPHERE, ARROW, TEXT = 2, 0, 9
ADD, DELETE_ALL = 0, 3
OK, WARN = 0, 1
FLOAT32, UINT32 = 7, 6
POINT_FIELDS = (("x", FLOAT32), ("y", FLOAT32), ("z", FLOAT32), ("probability", FLOAT32))
COLOURS = {
    TrackState.CONFIRMED: (0.84, 0.15, 0.16),
    TrackState.CANDIDATE: (0.95, 0.75, 0.10),
    TrackState.LOST: (0.55, 0.55, 0.55),
}

Triple = tuple[float, float, float]


@dataclass(frozen=True, kw_only=True)
class NodeHealth:
    """The health of a node.

    Attributes:
        problem: What a person should solve; empty where there is nothing.
        values: What became of everything that came in, by name.
    """

    problem: str
    values: dict[str, int]


class MessageBuilder:
    """Builds messages of one transport.

    Args:
        class_of: The class of a type name such as ``"std_msgs/msg/Header"``, whose constructor
            takes all its fields by name.
        frame_id: Of the world.
        octets: Turns (N,) uint8 into what the classes take for a field of bytes.
        octet: Turns a number into what they take for a single byte.
    """

    def __init__(
        self,
        class_of: Callable[[str], Any],
        frame_id: str,
        *,
        octets: Callable[[NDArray[np.uint8]], Any],
        octet: Callable[[int], Any] = int,
    ) -> None:
        self._class_of = class_of
        self._frame_id = frame_id
        self._octets = octets
        self._octet = octet

    def build_header(self, stamp_ns: int) -> Any:
        """`std_msgs/Header` in the world frame."""
        stamp = self._class_of("builtin_interfaces/msg/Time")(
            sec=stamp_ns // NS_PER_S, nanosec=stamp_ns % NS_PER_S
        )
        return self._class_of("std_msgs/msg/Header")(stamp=stamp, frame_id=self._frame_id)

    def build_leak_pose(self, update: PlumeUpdate) -> Any:
        """`PoseWithCovarianceStamped`: the source; its orientation is unknown."""
        covariance = np.zeros((6, 6))
        covariance[:3, :3] = update.plume.source_covariance
        covariance[3:, 3:] = UNKNOWN_VARIANCE * np.eye(3)
        pose = self._class_of("geometry_msgs/msg/PoseWithCovariance")(
            pose=self._build_pose(update.plume.source), covariance=covariance.ravel()
        )
        return self._class_of("geometry_msgs/msg/PoseWithCovarianceStamped")(
            header=self.build_header(update.stamp_ns), pose=pose
        )

    def build_diagnostics(self, name: str, health: NodeHealth, stamp_ns: int) -> Any:
        """`DiagnosticArray` of one node's health."""
        pair = self._class_of("diagnostic_msgs/msg/KeyValue")
        status = self._class_of("diagnostic_msgs/msg/DiagnosticStatus")(
            level=self._octet(WARN if health.problem else OK),
            name=name,
            message=health.problem or "running",
            hardware_id="",
            values=[pair(key=key, value=str(count)) for key, count in health.values.items()],
        )
        array = self._class_of("diagnostic_msgs/msg/DiagnosticArray")
        return array(header=self.build_header(stamp_ns), status=[status])

    def build_markers(self, updates: Iterable[PlumeUpdate], stamp_ns: int) -> Any:
        """`MarkerArray` of all plumes: the source's 2-sigma ellipsoid, the axis, and a label.

        It begins by deleting the markers before it, so the latest array alone is complete.
        """
        markers = [self._build_marker(stamp_ns, "", 0, kind=SPHERE, action=DELETE_ALL)]
        for update in updates:
            markers += self._plume_markers(update, stamp_ns)
        return self._class_of("visualization_msgs/msg/MarkerArray")(markers=markers)

    def _plume_markers(self, update: PlumeUpdate, stamp_ns: int) -> list[Any]:
        plume, colour = update.plume, COLOURS[update.state]
        variances, axes = np.linalg.eigh(plume.source_covariance)
        axes[:, 0] *= np.sign(np.linalg.det(axes))
        size = np.maximum(2 * MARKED_SIGMAS * np.sqrt(np.maximum(variances, 0)), LEAST_MARK_M)
        tip = plume.source + max(plume.extent_high, LEAST_MARK_M) * plume.axis
        width = float(plume.radius_by_height[:, 1].mean()) / 2
        sigma_m = float(plume.principal_sigmas[0])
        text = f"{plume.id} {update.state}\n{plume.probability:.3f}, {sigma_m:.2f} m"
        return [
            self._build_marker(
                stamp_ns,
                "source",
                plume.id,
                kind=SPHERE,
                pose=self._build_pose(plume.source, axes),
                scale=(float(size[0]), float(size[1]), float(size[2])),
                colour=(*colour, 0.5),
            ),
            self._build_marker(
                stamp_ns,
                "axis",
                plume.id,
                kind=ARROW,
                points=[self._build_point(plume.source), self._build_point(tip)],
                scale=(width, 2 * width, 0.0),
                colour=(*colour, 0.8),
            ),
            self._build_marker(
                stamp_ns,
                "label",
                plume.id,
                kind=TEXT,
                pose=self._build_pose(tip),
                scale=(0.0, 0.0, 0.25),
                colour=(*colour, 1.0),
                text=text,
            ),
        ]

    def build_point_cloud(self, updates: Iterable[PlumeUpdate], stamp_ns: int) -> Any:
        """`PointCloud2` of the plumes' outlines: x, y, z, probability and plume (its id)."""
        rows = [
            _outline_points(update.plume) for update in updates if update.state != TrackState.LOST
        ]
        points = np.concatenate(rows) if rows else np.zeros(0, _POINT_TYPE)
        field = self._class_of("sensor_msgs/msg/PointField")
        fields = [
            field(name=name, offset=4 * place, datatype=kind, count=1)
            for place, (name, kind) in enumerate((*POINT_FIELDS, ("plume", UINT32)))
        ]
        return self._class_of("sensor_msgs/msg/PointCloud2")(
            header=self.build_header(stamp_ns),
            height=1,
            width=len(points),
            fields=fields,
            is_bigendian=False,
            point_step=_POINT_TYPE.itemsize,
            row_step=_POINT_TYPE.itemsize * len(points),
            data=self._octets(points.view(np.uint8)),
            is_dense=True,
        )

    def _build_point(self, place: FloatArray) -> Any:
        x, y, z = map(float, place)
        return self._class_of("geometry_msgs/msg/Point")(x=x, y=y, z=z)

    def _build_pose(self, place: FloatArray, axes: FloatArray | None = None) -> Any:
        rotation = Rotation.identity() if axes is None else Rotation.from_matrix(axes)
        x, y, z, w = map(float, rotation.as_quat())
        quaternion = self._class_of("geometry_msgs/msg/Quaternion")(x=x, y=y, z=z, w=w)
        return self._class_of("geometry_msgs/msg/Pose")(
            position=self._build_point(place), orientation=quaternion
        )

    def _build_marker(
        self,
        stamp_ns: int,
        namespace: str,
        number: int,
        *,
        kind: int,
        action: int = ADD,
        pose: Any = None,
        points: list[Any] | None = None,
        scale: Triple = (0.0, 0.0, 0.0),
        colour: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 0.0),
        text: str = "",
    ) -> Any:
        red, green, blue, alpha = colour
        nothing = self._octets(np.zeros(0, np.uint8))
        compressed = self._class_of("sensor_msgs/msg/CompressedImage")
        return self._class_of("visualization_msgs/msg/Marker")(
            header=self.build_header(stamp_ns),
            ns=namespace,
            id=number,
            type=kind,
            action=action,
            pose=self._build_pose(np.zeros(3)) if pose is None else pose,
            scale=self._class_of("geometry_msgs/msg/Vector3")(x=scale[0], y=scale[1], z=scale[2]),
            color=self._class_of("std_msgs/msg/ColorRGBA")(r=red, g=green, b=blue, a=alpha),
            lifetime=self._class_of("builtin_interfaces/msg/Duration")(sec=0, nanosec=0),
            frame_locked=False,
            points=points or [],
            colors=[],
            texture_resource="",
            texture=compressed(
                header=self.build_header(0), format="", data=self._octets(np.zeros(0, np.uint8))
            ),
            uv_coordinates=[],
            text=text,
            mesh_resource="",
            mesh_file=self._class_of("visualization_msgs/msg/MeshFile")(filename="", data=nothing),
            mesh_use_embedded_materials=False,
        )


_POINT_TYPE = np.dtype([*((name, "<f4") for name, _ in POINT_FIELDS), ("plume", "<u4")])


def _outline_points(plume: Plume) -> NDArray[Any]:
    """The points of a plume's surface, ring by ring."""
    across = np.linalg.svd(plume.axis[None])[2][1:]
    distances = np.linspace(plume.extent_low, plume.extent_high, UPWARDS)
    radii = np.interp(distances, *plume.radius_by_height.T)
    angles = np.linspace(0, 2 * np.pi, AROUND, endpoint=False)
    ring = np.stack([np.cos(angles), np.sin(angles)], axis=1) @ across
    places = plume.points_on_axis(distances)[:, None] + radii[:, None, None] * ring
    points = np.zeros(UPWARDS * AROUND, _POINT_TYPE)
    points["x"], points["y"], points["z"] = places.reshape(-1, 3).T
    points["probability"], points["plume"] = plume.probability, plume.id
    return points
