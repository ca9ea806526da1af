"""How fast a camera moved and turned, by its path and by its telemetry, on one grid of times."""

import numpy as np
from scipy.ndimage import median_filter, uniform_filter1d
from scipy.spatial.transform import Rotation

from geometry.arrays import FloatArray
from geometry.errors import BadInputError
from geometry.normal_errors import MAD_TO_SIGMA
from locate.telemetry.resample import interpolate
from locate.telemetry.track import MAX_GAP_S, METRES_PER_DEGREE, TelemetryTrack

STEP_S = 0.1
"""Of the grid of times; chosen."""
WINDOW_S = 1.0
"""Speeds are means over this time; chosen."""
MIN_LENGTH_S = 10.0
"""Shortest profile that is compared; chosen."""
_MAX_STEPS = 2**20
"""Of the grid of times; bounds memory."""
_NEIGHBOURS, _FAR = 5, 8.0
"""A record so many typical distances from the median of its neighbours is a jump; chosen."""
_AXES = ("yaw", "pitch", "roll")


def path_speeds(times_s: FloatArray, centers: FloatArray) -> FloatArray:
    """(N,) speed along (N, 3) camera centres, in their unit per s."""
    return np.asarray(np.linalg.norm(np.gradient(centers, times_s, axis=0), axis=1))


def path_turns_dps(times_s: FloatArray, rotations: FloatArray) -> FloatArray:
    """(N,) angular speed of (N, 3, 3) rotations, deg/s; their direction does not matter."""
    step = Rotation.from_matrix(rotations[1:] @ np.swapaxes(rotations[:-1], 1, 2))
    rates = np.degrees(step.magnitude()) / np.diff(times_s)
    return np.asarray(np.interp(times_s, (times_s[1:] + times_s[:-1]) / 2, rates), dtype=float)


def time_grid(start_s: float, end_s: float, what: str) -> FloatArray:
    """(N,) times at `STEP_S`.

    Raises:
        BadInputError: Too short, too long, or not a number.
    """
    count = (end_s - start_s) / STEP_S
    if not MIN_LENGTH_S / STEP_S <= count <= _MAX_STEPS:
        raise BadInputError(
            f"{what}: {end_s - start_s:.1f} s are too short or too long to find a time offset "
            f"(at least {MIN_LENGTH_S:.0f} s, at most {_MAX_STEPS * STEP_S / 3600:.0f} h)"
        )
    return start_s + STEP_S * np.arange(int(count) + 1, dtype=float)


def speed_profile(track: TelemetryTrack) -> tuple[float, FloatArray]:
    """Start and (N,) speeds at `STEP_S`, over windows of `WINDOW_S`; NaN in gaps.

    Raises:
        BadInputError: No positions with times.
    """
    placed = track.take(track.has_position)
    if len(placed) < 2 or placed.times_s is None:
        raise BadInputError(f"{track.path}: needs positions with times to find a time offset")
    grid_s = time_grid(placed.times_s[0], placed.times_s[-1], str(track.path))
    if np.isfinite(placed.speed_mps).mean() > 0.9:
        stated = placed.at(grid_s).speed_mps
        return grid_s[0], smooth_profile(stated)
    moved = _without_jumps(placed.without_repeats())
    before, after = (moved.at(grid_s + shift_s) for shift_s in (-WINDOW_S / 2, WINDOW_S / 2))
    latitude_rad = np.radians(np.median(placed.latitude_deg))
    north_m = (after.latitude_deg - before.latitude_deg) * METRES_PER_DEGREE
    east_deg = (after.longitude_deg - before.longitude_deg + 180) % 360 - 180
    east_m = east_deg * METRES_PER_DEGREE * np.cos(latitude_rad)
    up_m = np.nan_to_num(after.altitude_m - before.altitude_m)
    return grid_s[0], clip_spikes(np.sqrt(north_m**2 + east_m**2 + up_m**2) / WINDOW_S)


def _without_jumps(track: TelemetryTrack) -> TelemetryTrack:
    """Without the records that stand far from the running median of their neighbours."""
    kept = np.ones(len(track), dtype=bool)
    for values in (track.latitude_deg, track.longitude_deg, np.nan_to_num(track.altitude_m)):
        away = np.abs(values - median_filter(values, _NEIGHBOURS, mode="nearest"))
        scale = MAD_TO_SIGMA * np.median(away[away > 0]) if (away > 0).any() else 0.0
        kept &= away <= _FAR * scale
    return track.take(kept)


def turn_profile(track: TelemetryTrack) -> tuple[float, FloatArray]:
    """The same of angular speeds, deg/s, of the gimbal or else of the vehicle.

    Raises:
        BadInputError: No angles with times.
    """
    what = "gimbal" if np.isfinite(track.gimbal_yaw_deg).sum() > 1 else "vehicle"
    angles = np.column_stack([getattr(track, f"{what}_{axis}_deg") for axis in _AXES])
    angles[:, 1:] = np.nan_to_num(angles[:, 1:])
    if track.times_s is None or np.isfinite(angles[:, 0]).sum() < 2:
        raise BadInputError(f"{track.path}: needs angles with times to find a time offset")
    grid_s = time_grid(track.times_s[0], track.times_s[-1], str(track.path))
    turned = np.column_stack(
        [interpolate(grid_s, track.times_s, a, MAX_GAP_S, period=360.0) for a in angles.T]
    )
    known = np.isfinite(turned[:, 0])
    rotations = Rotation.from_euler("ZYX", np.nan_to_num(turned), degrees=True).as_matrix()
    rates = path_turns_dps(grid_s, rotations)
    rates[~(known & np.roll(known, 1) & np.roll(known, -1))] = np.nan
    return float(grid_s[0]), clip_spikes(smooth_profile(rates))


def smooth_profile(values: FloatArray) -> FloatArray:
    """Means over `WINDOW_S` of what is known there."""
    known, size = np.isfinite(values), 2 * round(WINDOW_S / STEP_S / 2) + 1
    total = uniform_filter1d(np.where(known, values, 0.0), size, mode="nearest")
    share = uniform_filter1d(known.astype(float), size, mode="nearest")
    return np.where(share > 0.5, total / np.maximum(share, 0.5), np.nan)


def clip_spikes(values: FloatArray) -> FloatArray:
    """Without the spikes of a position that jumped."""
    known = values[np.isfinite(values)]
    if not len(known):
        return values
    median = np.median(known)
    spread = MAD_TO_SIGMA * np.median(np.abs(known - median))
    return np.asarray(np.minimum(values, median + 5 * max(spread, 0.1 * median)))
