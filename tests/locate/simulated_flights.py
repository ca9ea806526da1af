"""Flights with manoeuvres, their telemetry, and the path of their camera."""

from pathlib import Path

import numpy as np

from geometry.arrays import FloatArray
from geometry.errors import BadInputError
from locate.telemetry.assemble import track_from_columns
from locate.telemetry.offset import TimeOffset, estimate_offset
from locate.telemetry.profiles import path_speeds
from locate.telemetry.track import METRES_PER_DEGREE, TelemetryTrack

LENGTH_S, CAMERA_S, MEAN_SPEED_MPS = 180.0, 90.0, 5.0


def flight(rng: np.random.Generator, *, even: bool = False) -> tuple[FloatArray, FloatArray]:
    """Times (N,) at 50 Hz and positions (N, 3) in m of a flight by way points."""
    times_s = np.arange(0, LENGTH_S, 0.02)
    knots_s = np.arange(0, LENGTH_S + 8, 8.0)
    speed = np.full(len(knots_s), MEAN_SPEED_MPS)
    if not even:
        speed = rng.uniform(0.0, 2 * MEAN_SPEED_MPS, len(knots_s))
    course = np.cumsum(rng.normal(0, 0.8, len(knots_s)))
    v = np.interp(times_s, knots_s, speed)
    a = np.interp(times_s, knots_s, course)
    velocity = np.column_stack([v * np.cos(a), v * np.sin(a), 0.1 * v * np.sin(3 * a)])
    return times_s, np.cumsum(velocity, axis=0) * 0.02


def recorded(
    rng: np.random.Generator, times_s: FloatArray, positions_m: FloatArray, sigma_m: float
) -> TelemetryTrack:
    """5 Hz telemetry: white error of a third of sigma, the rest wandering over 30 s; outliers."""
    stamps_s = np.arange(0, LENGTH_S, 0.2)
    placed = np.column_stack([np.interp(stamps_s, times_s, p) for p in positions_m.T])
    keep = np.exp(-0.2 / 30.0)
    wander = rng.normal(0, sigma_m * np.sqrt(1 - keep**2), placed.shape)
    for i in range(1, len(wander)):
        wander[i] += keep * wander[i - 1]
    placed += wander + rng.normal(0, sigma_m / 3, placed.shape)
    jumps = rng.random(len(placed)) < 0.02
    placed[jumps] += rng.normal(0, 30.0, (int(jumps.sum()), 3))
    columns = {
        "times_s": stamps_s,
        "latitude_deg": 47.0 + placed[:, 1] / METRES_PER_DEGREE,
        "longitude_deg": 8.0 + placed[:, 0] / METRES_PER_DEGREE / np.cos(np.radians(47.0)),
        "altitude_m": 500.0 + placed[:, 2],
    }
    return track_from_columns(Path("simulated"), "simulated", columns)


def filmed(
    rng: np.random.Generator, times_s: FloatArray, positions_m: FloatArray, start_s: float
) -> tuple[FloatArray, FloatArray]:
    """Stamps (M,) at 10 Hz from 0 and speeds (M,) of a camera path in free units."""
    stamps_s = np.arange(0, CAMERA_S, 0.1)
    path = np.column_stack([np.interp(stamps_s + start_s, times_s, p) for p in positions_m.T])
    path = 0.137 * (path + rng.normal(0, 0.005, path.shape))
    return stamps_s, path_speeds(stamps_s, path)


def one(
    seed: int, sigma_m: float, *, even: bool = False, unrelated: bool = False
) -> tuple[float, TimeOffset | None]:
    """The true offset, and the answer if there was one."""
    rng = np.random.default_rng(seed)
    times_s, positions_m = flight(rng, even=even)
    track = recorded(rng, times_s, positions_m, sigma_m)
    if unrelated:
        times_s, positions_m = flight(rng)
    start_s = float(rng.uniform(20, 60))
    stamps_s, speeds = filmed(rng, times_s, positions_m, start_s)
    try:
        return start_s, estimate_offset(track, stamps_s, speeds)
    except BadInputError:
        return start_s, None
