"""MAVLink: poses from an autopilot, and leaks as it and its ground station understand them."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from pymavlink.dialects.v20 import common as mavlink
from scipy.spatial.transform import Rotation

from geometry.arrays import FloatArray
from geometry.errors import BadInputError
from geometry.georeference.geodesy import Georeference, HeightDatum
from locate.plume import Plume
from locate.robot.poses import UNKNOWN, StampedPose
from locate.robot.tracks import State, Update
from locate.robot.transforms import moved_covariance, tangent_covariance

TEXT_BYTES = 50
ABOVE_SOURCE_M = 10.0
LOITER_RADIUS_M = 40.0
WORLD_FROM_FRAME = {
    mavlink.MAV_FRAME_LOCAL_NED: np.array([[0.0, 1, 0], [1, 0, 0], [0, 0, -1]]),
    mavlink.MAV_FRAME_LOCAL_FRD: np.diag([1.0, -1, -1]),
}
FORWARD_CAMERA = np.array([[0.0, 0, 1, 0], [1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 0, 1]])
"""(4, 4) body_from_cam of a camera that looks ahead, body x forward, y right, z down."""


def camera_pose(message: Any, body_from_cam: FloatArray = FORWARD_CAMERA) -> StampedPose:
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
    covariance = _covariance(message.pose_covariance, turn, world_from_body)
    return StampedPose(
        stamp_ns=int(message.time_usec) * 1000,
        world_from_cam=world_from_body @ body_from_cam,
        covariance=moved_covariance(body_from_cam, covariance),
    )


def _covariance(
    triangle: Sequence[float], turn: FloatArray, world_from_body: FloatArray
) -> FloatArray:
    """(6, 6) in gtsam's right tangent; NaN where the autopilot does not know it."""
    upper = np.zeros((6, 6))
    upper[np.triu_indices(6)] = triangle
    if not np.isfinite(upper).all():
        return UNKNOWN
    whole = upper + np.triu(upper, 1).T
    both = np.kron(np.eye(2), turn)
    return tangent_covariance(world_from_body, (both @ whole @ both.T).ravel())


def status_text(update: Update) -> Any:
    """STATUSTEXT: one line for the pilot."""
    plume = update.plume
    text = f"plume {plume.id} {update.state}: {plume.principal_sigmas[0]:.2g} m"
    severity = (
        mavlink.MAV_SEVERITY_WARNING
        if update.state == State.CONFIRMED
        else mavlink.MAV_SEVERITY_INFO
    )
    return mavlink.MAVLink_statustext_message(severity, text.encode()[:TEXT_BYTES])


def region_of_interest(plume: Plume, origin: Georeference, *, system: int, component: int) -> Any:
    """COMMAND_INT with DO_SET_ROI_LOCATION: the camera turns to the source.

    Raises:
        BadInputError: The height of the source cannot be told above the sea or the take-off.
    """
    frame, (lat_deg, lon_deg, height_m) = _on_earth(plume.source, origin)
    return mavlink.MAVLink_command_int_message(
        target_system=system,
        target_component=component,
        frame=frame,
        command=mavlink.MAV_CMD_DO_SET_ROI_LOCATION,
        current=0,
        autocontinue=0,
        param1=0.0,
        param2=0.0,
        param3=0.0,
        param4=0.0,
        x=round(lat_deg * 1e7),
        y=round(lon_deg * 1e7),
        z=height_m,
    )


def plan(plumes: Sequence[Plume], origin: Georeference) -> dict[str, Any]:
    """A QGroundControl .plan: for each plume look at its source, then circle in its updraft.

    Raises:
        BadInputError: See `region_of_interest`.
    """
    items: list[dict[str, Any]] = []
    for plume in plumes:
        above = plume.source + ABOVE_SOURCE_M / max(float(plume.axis[2]), 0.1) * plume.axis
        for command, place, fourth in (
            (mavlink.MAV_CMD_DO_SET_ROI_LOCATION, plume.source, 0.0),
            (mavlink.MAV_CMD_NAV_LOITER_UNLIM, above, None),
        ):
            frame, where = _on_earth(place, origin)
            circle = LOITER_RADIUS_M if fourth is None else 0.0
            items.append(_item(command, frame, [0.0, 0.0, circle, fourth, *where], len(items) + 1))
    home = [origin.lat_deg, origin.lon_deg, origin.height_m]
    return {
        "fileType": "Plan",
        "version": 1,
        "groundStation": "locate",
        "geoFence": {"circles": [], "polygons": [], "version": 2},
        "rallyPoints": {"points": [], "version": 2},
        "mission": {
            "version": 2,
            "firmwareType": mavlink.MAV_AUTOPILOT_GENERIC,
            "vehicleType": mavlink.MAV_TYPE_GENERIC,
            "cruiseSpeed": 15,
            "hoverSpeed": 5,
            "plannedHomePosition": home,
            "items": items,
        },
    }


def _item(
    command: int, frame: int, parameters: Sequence[float | None], number: int
) -> dict[str, Any]:
    return {
        "type": "SimpleItem",
        "autoContinue": True,
        "command": command,
        "doJumpId": number,
        "frame": frame,
        "params": list(parameters),
    }


def _on_earth(point_in_enu: FloatArray, origin: Georeference) -> tuple[int, list[float]]:
    """MAVLink's frame, and latitude, longitude (deg) and altitude (m) in it."""
    lat_deg, lon_deg, height_m = origin.lat_lon_height(point_in_enu)[0].tolist()
    if origin.datum is HeightDatum.TAKEOFF:
        return mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT, [lat_deg, lon_deg, height_m]
    if not origin.datum.is_sea_level:
        heights = origin.heights_in(HeightDatum.EGM96, point_in_enu)
        if heights is None:
            raise BadInputError(
                f"heights count from {origin.datum}: an autopilot wants them above the sea or "
                "the take-off; give the origin so, or install PROJ's geoid (projsync --file egm96)"
            )
        height_m = float(heights[0])
    return mavlink.MAV_FRAME_GLOBAL, [lat_deg, lon_deg, height_m]
