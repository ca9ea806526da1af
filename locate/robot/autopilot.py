"""MAVLink: where the camera was, by the messages of an autopilot."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from pymavlink.dialects.v20 import common as mavlink
from scipy.spatial.transform import Rotation

from geometry.arrays import FloatArray
from geometry.errors import BadInputError
from geometry.georeference.geodesy import Georeference, HeightDatum
from locate.messages.poses import UNKNOWN_COVARIANCE, StampedPose
from locate.messages.transforms import camera_covariance, tangent_covariance

NS_PER_MS, NS_PER_US = 1_000_000, 1000
OLDEST_ATTITUDE_MS = 100
"""Largest difference of time between an attitude and a position that make a pose (chosen)."""
POSITION_SIGMA_M, ATTITUDE_SIGMA_RAD = 2.0, np.deg2rad(1.0)
"""Of GNSS without corrections and of a small autopilot (chosen)."""
WORLD_FROM_FRAME = {
    mavlink.MAV_FRAME_LOCAL_NED: np.array([[0.0, 1, 0], [1, 0, 0], [0, 0, -1]]),
    mavlink.MAV_FRAME_LOCAL_FRD: np.diag([1.0, -1, -1]),
}
FORWARD_CAMERA = np.array([[0.0, 0, 1, 0], [1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 0, 1]])
"""(4, 4) body_from_cam of a camera that looks ahead, body x forward, y right, z down."""


def pose_from_odometry(message: Any, body_from_cam: FloatArray = FORWARD_CAMERA) -> StampedPose:
    """The camera's pose by an ODOMETRY message, in a world with Z up.

    From LOCAL_NED the world is east-north-up; from LOCAL_FRD, whose heading is free, it is
    forward-left-up. Rotation covariances are taken to be about the axes of the local frame.

    Args:
        message: An ODOMETRY, its child frame BODY_FRD.
        body_from_cam: (4, 4) how the camera is mounted; body x forward, y right, z down.

    Raises:
        BadInputError: It is in another frame, or not finite.
    """
    turn = WORLD_FROM_FRAME.get(message.frame_id)
    if turn is None or message.child_frame_id != mavlink.MAV_FRAME_BODY_FRD:
        raise BadInputError(
            f"ODOMETRY from frame {message.frame_id} to {message.child_frame_id}: "
            "only LOCAL_NED or LOCAL_FRD to BODY_FRD is understood"
        )
    w, x, y, z = message.q
    numbers = np.array([message.x, message.y, message.z, w, x, y, z], dtype=float)
    if not np.isfinite(numbers).all() or np.linalg.norm(numbers[3:]) < 1e-6:
        raise BadInputError("ODOMETRY has no attitude, or numbers that are not finite")
    world_from_body = np.eye(4)
    world_from_body[:3, :3] = turn @ Rotation.from_quat([x, y, z, w]).as_matrix()
    world_from_body[:3, 3] = turn @ numbers[:3]
    covariance = _unpack_covariance(message.pose_covariance, turn, world_from_body)
    return StampedPose(
        stamp_ns=int(message.time_usec) * NS_PER_US,
        world_from_cam=world_from_body @ body_from_cam,
        covariance=camera_covariance(body_from_cam, covariance),
    )


def _unpack_covariance(
    triangle: Sequence[float], turn: FloatArray, world_from_body: FloatArray
) -> FloatArray:
    """(6, 6) in gtsam's right tangent; NaN where the autopilot does not know it."""
    upper = np.zeros((6, 6))
    upper[np.triu_indices(6)] = triangle
    if not np.isfinite(upper).all():
        return UNKNOWN_COVARIANCE
    whole = upper + np.triu(upper, 1).T
    both = np.kron(np.eye(2), turn)
    return tangent_covariance(world_from_body, (both @ whole @ both.T).ravel())


class Autopilot:
    """Poses from a stream of MAVLink messages; others are passed over.

    ODOMETRY holds a whole pose. GLOBAL_POSITION_INT holds the place alone, so the latest
    ATTITUDE or ATTITUDE_QUATERNION gives the rotation; it knows no covariance, and its errors are
    those of GNSS: enough to place a leak on the Earth, hardly enough to detect one.

    Args:
        origin: Of the east-north-up world that GLOBAL_POSITION_INT is put into.
        body_from_cam: (4, 4) how the camera is mounted; body x forward, y right, z down.
        sigma_m: Of the position by GLOBAL_POSITION_INT, m.
        sigma_rad: Of the attitude that goes with it, rad.
        boot_ns: Stamp of the autopilot's start on the clock of the images.

    Raises:
        BadInputError: The origin's heights count neither from the sea nor from the take-off.
    """

    def __init__(
        self,
        origin: Georeference,
        body_from_cam: FloatArray = FORWARD_CAMERA,
        *,
        sigma_m: float = POSITION_SIGMA_M,
        sigma_rad: float = ATTITUDE_SIGMA_RAD,
        boot_ns: int = 0,
    ) -> None:
        if origin.datum is not HeightDatum.TAKEOFF and not origin.datum.is_sea_level:
            raise BadInputError(
                f"heights count from {origin.datum}: give the origin above the sea or the take-off"
            )
        self._origin = origin
        self._body_from_cam = body_from_cam
        self._variances = np.repeat([sigma_rad, sigma_m], 3) ** 2
        self._boot_ns = boot_ns
        self._attitude: tuple[int, Rotation] | None = None

    def pose_from_message(self, message: Any) -> StampedPose | None:
        """The camera's pose by a message, or None where it does not hold one.

        Raises:
            BadInputError: An ODOMETRY in a frame that is not understood.
        """
        match message.get_type():
            case "ODOMETRY":
                return pose_from_odometry(message, self._body_from_cam)
            case "ATTITUDE":
                angles = [message.yaw, message.pitch, message.roll]
                self._attitude = message.time_boot_ms, Rotation.from_euler("ZYX", angles)
            case "ATTITUDE_QUATERNION":
                turn = [message.q2, message.q3, message.q4, message.q1]
                self._attitude = message.time_boot_ms, Rotation.from_quat(turn)
            case "GLOBAL_POSITION_INT":
                return self._pose_from_position(message)
        return None

    def _pose_from_position(self, message: Any) -> StampedPose | None:
        now_ms = int(message.time_boot_ms)
        if self._attitude is None or abs(now_ms - self._attitude[0]) > OLDEST_ATTITUDE_MS:
            return None
        above_start = self._origin.datum is HeightDatum.TAKEOFF
        height_m = (message.relative_alt if above_start else message.alt) / 1e3
        place = self._origin.to_enu([message.lat / 1e7, message.lon / 1e7, height_m])
        turn = WORLD_FROM_FRAME[mavlink.MAV_FRAME_LOCAL_NED]
        world_from_body = np.eye(4)
        world_from_body[:3, :3] = turn @ self._attitude[1].as_matrix()
        world_from_body[:3, 3] = place.reshape(3)
        return StampedPose(
            stamp_ns=self._boot_ns + now_ms * NS_PER_MS,
            world_from_cam=world_from_body @ self._body_from_cam,
            covariance=camera_covariance(self._body_from_cam, np.diag(self._variances)),
        )
