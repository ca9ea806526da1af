"""How much of the world a camera sees, and the limit of what a flat picture holds."""

import numpy as np

from geometry.camera import Camera
from geometry.errors import BadInputError

WIDEST_DEG = 120.0
"""Angle of view up to which images are flattened to a pinhole's picture."""
_STEPS = np.linspace(1, 1 / 16, 16)
"""Of the way from the middle to the edge; a fisheye's rays past 90 degrees come out turned."""


def angle_of_view_deg(camera: Camera) -> float:
    """The larger of the angles between the middles of opposite edges, deg; inf beyond 180."""
    middle = np.array([camera.width - 1, camera.height - 1]) / 2
    angles = []
    for half in (np.array([middle[0], 0]), np.array([0, middle[1]])):
        first = camera.rays(middle - _STEPS[:, None] * half)
        second = camera.rays(middle + _STEPS[:, None] * half)
        cosines = (first * second).sum(axis=1)
        angles.append(np.degrees(np.arccos(cosines.clip(-1, 1))))
    return float(np.nan_to_num(angles, nan=np.inf).max())


def refuse_wide_lens(camera: Camera) -> None:
    """Refuses a camera whose pictures cannot be flattened.

    Raises:
        BadInputError: It sees more than 120 degrees.
    """
    angle_deg = angle_of_view_deg(camera)
    if angle_deg > WIDEST_DEG:
        angle = f"{angle_deg:.0f} degrees" if np.isfinite(angle_deg) else "over 180 degrees"
        raise BadInputError(
            f"this lens sees {angle}; wide lenses beyond {WIDEST_DEG:.0f} degrees are not "
            "supported: film with a narrower one, or crop the recording"
        )
