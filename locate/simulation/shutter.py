"""How long a frame takes: the exposure that blurs it, the readout that bends it."""

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from geometry.arrays import FloatArray, FloatMap
from geometry.trajectory import Trajectory


@dataclass(frozen=True, kw_only=True)
class Shutter:
    """The timing of a camera; the pose of a frame is that of its middle.

    Attributes:
        readout_s: From the first row to the last (rolling shutter).
        exposure_s: During which each pixel gathers light (motion blur), shared out over its rays.
        gains: Exposure of each frame, times that of the scene; none means 1 for all.
    """

    readout_s: float = 0.0
    exposure_s: float = 0.0
    gains: tuple[float, ...] = ()

    @property
    def is_instant(self) -> bool:
        """Every ray of a frame is of one moment."""
        return not (self.readout_s or self.exposure_s)

    def frame_gain(self, i: int) -> float:
        """That of frame `i`."""
        return self.gains[i] if self.gains else 1.0

    def delays_s(self, shape: tuple[int, ...], samples: int) -> FloatMap:
        """(H, W) of each ray, after the middle of its frame, for samples x samples rays a pixel."""
        rows, columns = np.ogrid[: shape[0], : shape[1]]
        readout = (rows // samples + 0.5) * samples / shape[0] - 0.5
        count = samples**2
        share = ((rows % samples) * samples + columns % samples + 0.5) / count - 0.5
        return np.asarray(self.readout_s * readout + self.exposure_s * share, dtype=np.float32)


INSTANT = Shutter()


def camera_velocities(trajectory: Trajectory, i: int) -> tuple[FloatArray, FloatArray]:
    """How the camera moves at frame `i`, by the frames beside it.

    Returns:
        (3,) velocity of its centre, world units per s; (3,) angular velocity in the world, rad/s.
    """
    before, after = max(i - 1, 0), min(i + 1, len(trajectory) - 1)
    if before == after:
        return np.zeros(3), np.zeros(3)
    passed_s = trajectory.times_s[after] - trajectory.times_s[before]
    centers = trajectory.centers_in_world
    turn = trajectory.rotations[after].T @ trajectory.rotations[before]
    return (
        (centers[after] - centers[before]) / passed_s,
        Rotation.from_matrix(turn).as_rotvec() / passed_s,
    )
