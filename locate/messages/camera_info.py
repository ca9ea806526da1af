"""Calibrations as every transport carries them, to cameras: read whole, or refused by name."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from geometry.angle_of_view import refuse_wide_lens
from geometry.camera import Camera
from geometry.errors import BadInputError

_STRAIGHT = ("", "none", "pinhole", "perspective", "brown_conrady", "inverse_brown_conrady")
"""Names of distortion models that are none where all coefficients are zero."""
_PLUMB = ("OPENCV", (4, 5))
_FISHEYE = ("OPENCV_FISHEYE", (4,))
_DISTORTIONS = {
    "plumb_bob": _PLUMB,
    "radtan": _PLUMB,
    "rational_polynomial": ("FULL_OPENCV", (4, 5, 8)),
    "equidistant": _FISHEYE,
    "fisheye": _FISHEYE,
    "kannala_brandt": _FISHEYE,
    "kannala_brandt4": _FISHEYE,
}
"""COLMAP's model, and how many coefficients there may be, by the distortion model's name."""


def camera_from_info(message: Any, *, rectified: bool = False) -> Camera:
    """The camera of a `sensor_msgs/CameraInfo`, binning and region of interest applied.

    Args:
        message: Of ROS 2 or ROS 1.
        rectified: The images are rectified: the projection matrix holds, without distortion.

    Raises:
        BadInputError: It is not calibrated, its distortion model is not known, or the lens sees
            more than 120 degrees.
    """
    matrix = _calibration_matrix(message, rectified=rectified)
    if not is_calibrated(message, rectified=rectified):
        raise BadInputError("camera_info has no focal length: calibrate the camera")
    if matrix[0, 1] != 0:
        raise BadInputError(
            f"camera_info has a skew of {matrix[0, 1]:g} px, which is not supported"
        )
    fx, fy, cx, cy = matrix[0, 0], matrix[1, 1], matrix[0, 2], matrix[1, 2]
    roi = message.roi
    across, down = max(int(message.binning_x), 1), max(int(message.binning_y), 1)
    width, height = int(roi.width) or int(message.width), int(roi.height) or int(message.height)
    focal_and_centre = (
        fx / across,
        fy / down,
        (cx - roi.x_offset + 0.5) / across - 0.5,
        (cy - roi.y_offset + 0.5) / down - 0.5,
    )
    model: str = "PINHOLE"
    more: tuple[float, ...] = ()
    if not rectified:
        coefficients = np.array(_read_field(message, "d"), dtype=float)
        model, more = _convert_distortion(message.distortion_model, coefficients)
    params = (*focal_and_centre, *more)
    camera = Camera(
        model=model,
        width=width // across,
        height=height // down,
        params=tuple(float(value) for value in params),
    )
    refuse_wide_lens(camera)
    return camera


def is_calibrated(message: Any, *, rectified: bool = False) -> bool:
    """True where a `sensor_msgs/CameraInfo` has focal lengths; drivers without leave zeros."""
    matrix = _calibration_matrix(message, rectified=rectified)
    return bool(matrix[0, 0] > 0 and matrix[1, 1] > 0)


def _calibration_matrix(message: Any, *, rectified: bool) -> NDArray[np.float64]:
    """(3, 3 or 4) the matrix that projects into the images.

    Raises:
        BadInputError: It has another number of entries.
    """
    columns = 4 if rectified else 3
    matrix = np.array(_read_field(message, "p" if rectified else "k"), dtype=float)
    if matrix.size != 3 * columns:
        raise BadInputError(f"camera_info has a matrix of {matrix.size} numbers")
    return matrix.reshape(3, columns)


def _read_field(message: Any, name: str) -> Any:
    """A field that ROS 1 writes in capitals."""
    return getattr(message, name) if hasattr(message, name) else getattr(message, name.upper())


def _convert_distortion(
    name: str, coefficients: NDArray[np.float64]
) -> tuple[str, tuple[float, ...]]:
    """COLMAP's model, and its parameters after the principal point."""
    kind = name.strip().lower()
    fisheye = _DISTORTIONS.get(kind) == _FISHEYE
    if not coefficients.any() and not fisheye and (kind in _STRAIGHT or kind in _DISTORTIONS):
        return "PINHOLE", ()
    if kind not in _DISTORTIONS:
        known = ", ".join(_DISTORTIONS)
        raise BadInputError(f"distortion model {name!r} is not supported, only {known}")
    model, counts = _DISTORTIONS[kind]
    used = [count for count in counts if not coefficients[count:].any()]
    if len(coefficients) < counts[0] or not used:
        raise BadInputError(
            f"{name} takes {' or '.join(map(str, counts))} coefficients, got {len(coefficients)}"
        )
    if fisheye:
        return model, tuple(coefficients[:4])
    if not coefficients[4:].any():
        return "OPENCV", tuple(coefficients[:4])
    values = np.zeros(8)
    values[: min(8, len(coefficients))] = coefficients[:8]
    return "FULL_OPENCV", tuple(values)
