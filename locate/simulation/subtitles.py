"""What a drone's receiver and gimbal write beside its video."""

import datetime as dt
from pathlib import Path
from typing import Annotated

import numpy as np
from pydantic import Field

from geometry.arrays import FloatArray
from geometry.georeference import Georeference
from geometry.trajectory import Trajectory
from locate.simulation.scene import Positive, SceneBlock

NotNegative = Annotated[float, Field(ge=0)]
LEVEL = 1e-6


class GpsReceiver(SceneBlock):
    """How GPS and gimbal err.

    A fix errs by white noise of `white_m` and by a part that wanders: `wander_m` (one sigma),
    correlated over `wander_s`; vertically by `vertical` times that. A share of the fixes lies up
    to `outlier_m` off along each axis. The gimbal is off by `gimbal_deg` (one sigma), the same for
    a whole flight; without it no attitude is written.
    """

    white_m: NotNegative = 0.3
    wander_m: NotNegative = 0.4
    wander_s: Positive = 60.0
    vertical: NotNegative = 1.6
    outliers: Annotated[float, Field(ge=0, lt=0.5)] = 0.03
    outlier_m: NotNegative = 20.0
    gimbal_deg: NotNegative | None = 0.3

    def simulate_fixes(
        self, times_s: FloatArray, points_in_enu: FloatArray, rng: np.random.Generator
    ) -> FloatArray:
        """(N, 3) what the receiver takes for (N, 3) true positions."""
        shape = points_in_enu.shape
        steps = rng.normal(size=shape)
        wander = steps.copy()
        for i, gap_s in enumerate(np.diff(times_s), start=1):
            keep = np.exp(-gap_s / self.wander_s)
            wander[i] = keep * wander[i - 1] + np.sqrt(1 - keep**2) * steps[i]
        errors = self.white_m * rng.normal(size=shape) + self.wander_m * wander
        errors *= [1, 1, self.vertical]
        wrong = rng.uniform(size=len(errors)) < self.outliers
        errors[wrong] += self.outlier_m * rng.uniform(-1, 1, size=(int(wrong.sum()), 3))
        return np.asarray(points_in_enu + errors)


def attitude_deg(rotations: FloatArray) -> FloatArray:
    """(N, 3) yaw from north, pitch, roll of cameras (N, 3, 3) in east-north-up."""
    right, down, forward = np.moveaxis(rotations, 1, 0)
    yaw = np.arctan2(forward[:, 0], forward[:, 1])
    pitch = np.arcsin(np.clip(forward[:, 2], -1, 1))
    steep = np.hypot(right[:, 2], down[:, 2]) < LEVEL
    roll = np.where(steep, 0.0, np.arctan2(-right[:, 2], -down[:, 2]))
    yaw = np.where(steep, np.arctan2(-down[:, 0], -down[:, 1]), yaw)
    return np.asarray(np.degrees(np.stack([yaw, pitch, roll], axis=1)))


def write_subtitles(
    path: Path,
    trajectory: Trajectory,
    place: Georeference,
    receiver: GpsReceiver,
    *,
    start: dt.datetime,
    rng: np.random.Generator,
) -> None:
    """Writes a .SRT file in DJI's newer dialect, one subtitle a frame.

    Args:
        path: The file.
        trajectory: True poses in east-north-up, m.
        place: Where that frame sits on the Earth; it counts as take-off.
        receiver: How it errs.
        start: Local time of the first frame.
        rng: Its random numbers.
    """
    times_s = trajectory.times_s
    fixes = receiver.simulate_fixes(times_s, trajectory.centers_in_world, rng)
    angles = attitude_deg(trajectory.rotations)
    if receiver.gimbal_deg is not None:
        angles = angles + receiver.gimbal_deg * rng.normal(size=3)
    positions = place.lat_lon_height(fixes)
    ends_s = np.append(times_s[1:], times_s[-1] + (times_s[1] if len(times_s) > 1 else 0.04))
    cues = []
    for i, (lat, lon, height) in enumerate(positions):
        moment = start + dt.timedelta(seconds=float(times_s[i]))
        attitude = "gb_yaw: {:.2f} gb_pitch: {:.2f} gb_roll: {:.2f}".format(*angles[i])
        cues.append(
            f"{i + 1}\n{_format_timestamp(times_s[i])} --> {_format_timestamp(ends_s[i])}\n"
            f'<font size="28">FrameCnt: {i + 1}\n'
            f"{moment.isoformat(sep=' ', timespec='milliseconds')}\n"
            f"[latitude: {lat:.7f}] [longitude: {lon:.7f}] "
            f"[rel_alt: {fixes[i, 2]:.3f} abs_alt: {height:.3f}]"
            + ("" if receiver.gimbal_deg is None else f" [{attitude}]")
            + " </font>\n"
        )
    path.write_text("\n".join(cues))


def _format_timestamp(time_s: float) -> str:
    seconds, millis = divmod(round(time_s * 1000), 1000)
    return f"{seconds // 3600:02d}:{seconds // 60 % 60:02d}:{seconds % 60:02d},{millis:03d}"
