"""A small answer to write, read and judge: an orbit, a plume, a map."""

from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from geometry.arrays import FloatArray
from geometry.camera import Camera
from geometry.trajectory import Trajectory
from locate.map.plume import Bearing, Plume, PlumeMap

SOURCE = np.array([0.3, -0.2, 0.1])


def orbit(n: int = 12, *, arc_deg: float = 60.0, radius: float = 8.0, **flags: Any) -> Trajectory:
    """Cameras on an arc about the origin, looking at it from a height of 1."""
    angles = np.radians(np.linspace(-arc_deg / 2, arc_deg / 2, n))
    centers = np.stack([radius * np.cos(angles), radius * np.sin(angles), np.ones(n)], axis=1)
    forward = -centers / np.linalg.norm(centers, axis=1, keepdims=True)
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right, axis=1, keepdims=True)
    rotations = np.stack([right, np.cross(forward, right), forward], axis=1)
    return Trajectory(
        camera=Camera.pinhole(64, 48, 60.0),
        indices=2 * np.arange(n),
        times_s=0.1 * np.arange(n),
        rotations=rotations,
        translations=-np.einsum("nij,nj->ni", rotations, centers),
        **flags,
    )


def plume(source: FloatArray = SOURCE, **changes: Any) -> Plume:
    """A plume that leans a little, known to 10, 20 and 30 mm along turned axes."""
    turn = Rotation.from_euler("xyz", [0.3, 0.2, 0.1]).as_matrix()
    axis = np.array([0.1, 0.0, 1.0])
    fields: dict[str, Any] = {
        "id": 1,
        "source": source,
        "source_covariance": turn @ np.diag([0.01, 0.02, 0.03]) ** 2 @ turn.T,
        "axis": axis / np.linalg.norm(axis),
        "axis_sigma_rad": 0.02,
        "extent_low": 0.1,
        "extent_high": 2.0,
        "radius_by_height": np.array([[0.0, 0.05], [1.0, 0.1], [2.0, 0.2]]),
        "evidence_nats": 41.5,
        "probability": 0.9999,
        "views": (0, 2, 4),
        "displacement_px": 0.7,
    }
    return Plume(**fields | changes)


def bearing_ahead() -> Bearing:
    """A direction along the optical axis."""
    return Bearing(
        direction_in_cam=np.array([0.0, 0.0, 1.0]),
        sigma_rad=0.01,
        evidence_nats=9.0,
        probability=0.9,
        displacement_px=0.4,
    )


def plume_map(*plumes: Plume, **changes: Any) -> PlumeMap:
    """A metric map of the given plumes."""
    fields: dict[str, Any] = {
        "units": "m",
        "gravity": True,
        "detector": "registered",
        "version": "0.0.test",
        "detection_limit_px": 0.25,
    }
    return PlumeMap(**fields | {"plumes": plumes} | changes)
