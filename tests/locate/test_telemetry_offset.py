"""The time offset between video and telemetry, on simulated flights."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from geometry.errors import BadInputError
from locate.telemetry import (
    estimate_offset,
    estimate_offset_from_turns,
    path_speeds,
    path_turns_dps,
)
from tests.locate.simulated_flights import filmed, flight, one, recorded
from tests.locate.test_telemetry import track

FLIGHTS = range(1000, 1012)


def test_offset_is_found_with_its_sigma() -> None:
    runs = [one(seed, 0.5) for seed in FLIGHTS]
    answers = [(truth, found) for truth, found in runs if found is not None]
    assert len(answers) >= 11
    error_s = np.array([found.offset_s - truth for truth, found in answers])
    sigma_s = np.array([found.sigma_s for _, found in answers])
    assert np.abs(error_s).max() < 0.15
    assert 0.5 < np.sqrt(np.mean((error_s / sigma_s) ** 2)) < 1.7
    assert all(found.correlation > found.rival for _, found in answers)


@pytest.mark.parametrize("how", [{"unrelated": True}, {"even": True}])
def test_it_does_not_guess(how: dict[str, bool]) -> None:
    assert [one(seed, 0.5, **how)[1] for seed in FLIGHTS] == [None] * len(FLIGHTS)


def test_a_flight_of_equal_laps_is_refused() -> None:
    times_s = np.arange(0, 300, 0.2)
    eastward = 5.0 * (times_s + np.sin(2 * np.pi * times_s / 30) * 30 / 2 / np.pi)
    found = track(
        times_s=times_s,
        latitude_deg=np.full(len(times_s), 47.0),
        longitude_deg=8 + eastward / 76_000,
    )
    stamps_s = np.arange(0, 90, 0.2)
    speeds = 1 + np.cos(2 * np.pi * (stamps_s + 47) / 30)
    with pytest.raises(BadInputError, match="does not determine the time offset"):
        estimate_offset(found, stamps_s, speeds)
    near = estimate_offset(found, stamps_s, speeds, search_s=(40, 54))
    assert near.offset_s == pytest.approx(47, abs=0.1)


def test_a_staircase_of_slow_positions_does_not_bias() -> None:
    rng = np.random.default_rng(7)
    times_s, positions_m = flight(rng)
    held_s = np.floor(np.arange(0, 180, 1 / 30) * 5) / 5  # 5 Hz positions in a file of 30 Hz
    east, north, up = (np.interp(held_s, times_s, axis) for axis in positions_m.T)
    found = track(
        times_s=np.arange(0, 180, 1 / 30),
        latitude_deg=47 + north / 111_320,
        longitude_deg=8 + east / 111_320 / np.cos(np.radians(47)),
        altitude_m=500 + up,
    )
    offset = estimate_offset(found, *filmed(rng, times_s, positions_m, 33.0))
    assert offset.offset_s == pytest.approx(33.0, abs=0.03)


def test_outliers_and_gaps_do_not_matter() -> None:
    rng = np.random.default_rng(11)
    times_s, positions_m = flight(rng)
    whole = recorded(rng, times_s, positions_m, 0.5)
    assert whole.times_s is not None
    found = whole.take((whole.times_s < 70) | (whole.times_s > 80))
    offset = estimate_offset(found, *filmed(rng, times_s, positions_m, 40.0))
    assert offset.offset_s == pytest.approx(40.0, abs=4 * offset.sigma_s)
    assert offset.sigma_s < 0.1


def test_offset_from_turns() -> None:
    rng = np.random.default_rng(3)
    times_s = np.arange(0, 120, 0.1)
    knots_s = np.arange(0, 125, 5.0)
    yaw, pitch = (
        np.interp(times_s, knots_s, np.cumsum(rng.normal(0, size, len(knots_s))))
        for size in (40.0, 5.0)
    )
    noisy = yaw + rng.normal(0, 0.05, len(yaw))
    found = track(
        times_s=times_s, gimbal_yaw_deg=(noisy + 180) % 360 - 180, gimbal_pitch_deg=pitch - 40
    )
    stamps_s = np.arange(0, 60, 0.1)
    angles = [np.interp(stamps_s + 21.3, times_s, a) for a in (yaw, pitch - 40)]
    ned_from_cam = Rotation.from_euler("ZY", np.column_stack(angles), degrees=True)
    cam_from_world = (ned_from_cam.inv() * Rotation.random(random_state=1)).as_matrix()
    offset = estimate_offset_from_turns(found, stamps_s, path_turns_dps(stamps_s, cam_from_world))
    assert offset.offset_s == pytest.approx(21.3, abs=0.02)
    assert offset.correlation > 0.9


def test_too_short_or_without_positions_is_refused() -> None:
    stamps_s = np.arange(0, 60, 0.1)
    short = track(times_s=[0, 5], latitude_deg=[47, 47.1], longitude_deg=[8, 8])
    with pytest.raises(BadInputError, match="too short or too long"):
        estimate_offset(short, stamps_s, stamps_s)
    angles = track(times_s=stamps_s, gimbal_pitch_deg=stamps_s)
    with pytest.raises(BadInputError, match="needs positions with times"):
        estimate_offset(angles, stamps_s, stamps_s)
    with pytest.raises(BadInputError, match="needs angles with times"):
        estimate_offset_from_turns(short, stamps_s, stamps_s)
    sparse = track(times_s=[0, 100, 200], latitude_deg=[47, 47.1, 47.3], longitude_deg=[8, 8, 8])
    with pytest.raises(BadInputError, match="too full of gaps"):
        estimate_offset(sparse, stamps_s, stamps_s)


def test_speed_and_turns_of_a_circle() -> None:
    times_s = np.arange(0, 10, 0.01)
    angle = 0.3 * times_s
    centers = 4 * np.column_stack([np.cos(angle), np.sin(angle), np.zeros_like(angle)])
    assert path_speeds(times_s, centers) == pytest.approx(np.full(1000, 1.2), rel=1e-2)
    rotations = Rotation.from_euler("z", angle[:, None]).as_matrix()
    assert path_turns_dps(times_s, rotations) == pytest.approx(np.full(1000, np.degrees(0.3)))
