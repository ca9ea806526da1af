"""How well the time offset between a video and its telemetry is found, on simulated flights.

    python -m benchmarks.telemetry_offset [--flights 40]

A flight of 3 minutes with manoeuvres; 5 Hz telemetry with white and slowly wandering GPS error
and 2 % outliers of 30 m; a camera path in free units, 5 mm off, from the middle of it. Printed for
each GPS error: how many were answered, the error of the answers, and that error over the stated
sigma. Flights at one speed, and flights of another track, must not be answered.
"""

import argparse
from collections.abc import Iterable
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from geometry.arrays import FloatArray
from geometry.errors import BadInputError
from locate.telemetry.assemble import track_from_columns
from locate.telemetry.offset import TimeOffset, estimate_offset, estimate_offset_from_turns
from locate.telemetry.profiles import path_speeds, path_turns_dps
from locate.telemetry.track import METRES_PER_DEGREE, TelemetryTrack

LENGTH_S, CAMERA_S, MEAN_SPEED_MPS = 180.0, 90.0, 5.0
FIRST_SEED = 20_000  # none that a limit was chosen on


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


def estimate_one(
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


def one_turn(seed: int, noise_deg: float) -> tuple[float, TimeOffset | None]:
    """The same from a gimbal that turns every 5 s, 10 Hz angles with white noise."""
    rng = np.random.default_rng(seed)
    times_s = np.arange(0, LENGTH_S, 0.1)
    knots_s = np.arange(0, LENGTH_S + 5, 5.0)
    turns = (np.cumsum(rng.normal(0, size, len(knots_s))) for size in (40.0, 5.0))
    yaw, pitch = (np.interp(times_s, knots_s, turn) for turn in turns)
    columns = {
        "times_s": times_s,
        "gimbal_yaw_deg": (yaw + rng.normal(0, noise_deg, len(yaw)) + 180) % 360 - 180,
        "gimbal_pitch_deg": pitch + rng.normal(0, noise_deg, len(pitch)) - 40,
    }
    track = track_from_columns(Path("simulated"), "simulated", columns)
    start_s, stamps_s = float(rng.uniform(20, 60)), np.arange(0, CAMERA_S, 0.1)
    seen = [np.interp(stamps_s + start_s, times_s, angle) for angle in (yaw, pitch - 40)]
    rotations = Rotation.from_euler("ZY", np.column_stack(seen), degrees=True).as_matrix()
    try:
        turns_dps = path_turns_dps(stamps_s, rotations)
        return start_s, estimate_offset_from_turns(track, stamps_s, turns_dps)
    except BadInputError:
        return start_s, None


def report(name: str, runs: Iterable[tuple[float, TimeOffset | None]]) -> None:
    """One line of the table."""
    answers = list(runs)
    found = [(truth, answer) for truth, answer in answers if answer is not None]
    line = f"{name:28s} answered {len(found):3d} of {len(answers)}"
    if found:
        error_s = np.array([answer.offset_s - truth for truth, answer in found])
        sigma_s = np.array([answer.sigma_s for _, answer in found])
        line += (
            f"   |error| median {np.median(np.abs(error_s)):.3f} max {np.abs(error_s).max():.3f} s"
            f"   rms(error / sigma) {np.sqrt(np.mean((error_s / sigma_s) ** 2)):.2f}"
        )
    print(line)


def main() -> None:
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.telemetry_offset",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--flights", type=int, default=40)
    seeds = range(FIRST_SEED, FIRST_SEED + parser.parse_args().flights)
    for metres in (0.1, 0.5, 1.0, 2.0):
        report(f"GPS error {metres} m", (estimate_one(seed, metres) for seed in seeds))
    report("even speed, GPS 0.5 m", (estimate_one(seed, 0.5, even=True) for seed in seeds))
    report("another flight, GPS 0.5 m", (estimate_one(seed, 0.5, unrelated=True) for seed in seeds))
    for degrees in (0.05, 0.3):
        report(f"gimbal turns, noise {degrees} deg", (one_turn(seed, degrees) for seed in seeds))


if __name__ == "__main__":
    main()
