"""MAVLink: leaks as messages and plans for an autopilot and its ground station."""

from collections.abc import Sequence
from typing import Any

from pymavlink.dialects.v20 import common as mavlink

from geometry.arrays import FloatArray
from geometry.errors import BadInputError
from geometry.georeference.geodesy import Georeference, HeightDatum
from locate.map.plume import Plume
from locate.robot.plume_tracks import PlumeUpdate, TrackState

TEXT_BYTES = 50
ABOVE_SOURCE_M = 10.0
LOITER_RADIUS_M = 40.0


def status_text(update: PlumeUpdate) -> Any:
    """STATUSTEXT: one line for the pilot."""
    plume = update.plume
    text = f"plume {plume.id} {update.state}: {plume.principal_sigmas[0]:.2g} m"
    severity = (
        mavlink.MAV_SEVERITY_WARNING
        if update.state == TrackState.CONFIRMED
        else mavlink.MAV_SEVERITY_INFO
    )
    return mavlink.MAVLink_statustext_message(severity, text.encode()[:TEXT_BYTES])


def region_of_interest(plume: Plume, origin: Georeference, *, system: int, component: int) -> Any:
    """COMMAND_INT with DO_SET_ROI_LOCATION: the camera turns to the source.

    Raises:
        BadInputError: The height of the source above the sea or the take-off is unknown.
    """
    frame, (lat_deg, lon_deg, height_m) = _global_position(plume.source, origin)
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


def landing_target(plume: Plume, *, time_us: int) -> Any:
    """LANDING_TARGET: the source as a place to land; nothing here sends it by itself.

    Only where the map's world is the autopilot's own local frame, turned from north-east-down to
    east-north-up, as it is with ODOMETRY for poses.

    Args:
        plume: Whose source it is.
        time_us: On the autopilot's clock.
    """
    east, north, up = plume.source.tolist()
    return mavlink.MAVLink_landing_target_message(
        time_usec=time_us,
        target_num=plume.id,
        frame=mavlink.MAV_FRAME_LOCAL_NED,
        angle_x=0.0,
        angle_y=0.0,
        distance=0.0,
        size_x=0.0,
        size_y=0.0,
        x=north,
        y=east,
        z=-up,
        q=[1.0, 0.0, 0.0, 0.0],
        type=mavlink.LANDING_TARGET_TYPE_VISION_OTHER,
        position_valid=1,
    )


def mission_plan(plumes: Sequence[Plume], origin: Georeference) -> dict[str, Any]:
    """A QGroundControl .plan: turn the camera to each source, then circle in its updraft.

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
            frame, where = _global_position(place, origin)
            circle = LOITER_RADIUS_M if fourth is None else 0.0
            items.append(
                _mission_item(command, frame, [0.0, 0.0, circle, fourth, *where], len(items) + 1)
            )
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


def _mission_item(
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


def _global_position(point_in_enu: FloatArray, origin: Georeference) -> tuple[int, list[float]]:
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
