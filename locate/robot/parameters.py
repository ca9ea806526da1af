"""The node's parameters: their default values, and what they mean."""

from dataclasses import fields
from typing import Any, get_type_hints

from locate.robot.settings import LocatorSettings

_OF_THE_NODE: dict[str, tuple[Any, str]] = {
    "world_frame": ("map", "Frame of the map, Z up: map, or odom where there is no map."),
    "camera_frame": ("", "Optical frame of the camera; empty takes it from the images."),
    "body_frame": ("", "Frame whose pose comes in; empty takes the odometry's child frame."),
    "pose_source": ("tf", "Where poses come from: tf, odometry or pose."),
    "pose_sigma_m": (0.0, "Position sigma of poses that come without one, m; 0 is unknown."),
    "pose_sigma_deg": (0.0, "Rotation sigma of poses that come without one; 0 is unknown."),
    "image_transport": ("raw", "raw or compressed."),
    "rectified": (False, "The images are rectified (image_rect): no distortion is left."),
    "autostart": (True, "Detect from the beginning, not only once start is called."),
    "output": ("~/locate", "Folder that the service save writes map.json into."),
}


_PARAMETER_OF_FIELD = {"detector_workers": "lookers"}
"""Settings whose parameter has another name: robots are configured by it."""


def parameter_of(field: str) -> str:
    """The parameter that sets a field of `LocatorSettings` or `Wiring`."""
    return _PARAMETER_OF_FIELD.get(field, field)


def _describe_settings() -> dict[str, tuple[Any, str]]:
    """The parameters of `LocatorSettings`, with the words of their annotations."""
    words = get_type_hints(LocatorSettings, include_extras=True)
    return {
        parameter_of(field.name): (field.default, words[field.name].__metadata__[0])
        for field in fields(LocatorSettings)
    }


PARAMETERS = _OF_THE_NODE | _describe_settings()
