"""What lasts from frame to frame, against frames whose displacement is known."""

import numpy as np
import pytest

from detect.fluctuation import WINDOW_PX, Fluctuation, longest_run
from tests.detect.fluctuating import PERIOD, frames, plume


def test_a_pattern_far_below_the_noise_of_one_frame_shows_in_time() -> None:
    found = Fluctuation.measure(frames(0.1), np.random.default_rng(0))
    inside = plume()
    assert not found.is_everywhere
    assert np.median(found.sigmas[inside]) > 3.5
    assert np.quantile(found.sigmas[:, :60], 0.99) < 3.5


def test_its_covariance_is_that_of_the_true_displacement_but_for_the_window() -> None:
    amplitude_px = 0.3
    found = Fluctuation.measure(
        frames(amplitude_px, noise=0.5, springs=True), np.random.default_rng(0)
    )
    true = amplitude_px**2 / 2 * np.cos(2 * np.pi / PERIOD)
    window = np.exp(-((2 * np.pi * WINDOW_PX / 20) ** 2))
    measured = np.median(found.covariance_px2[40:70, [94, 95, 109, 110]])
    assert measured == pytest.approx(true * window, rel=0.2)


def test_noise_alone_is_not_coherent() -> None:
    found = Fluctuation.measure(frames(0.0), np.random.default_rng(0))
    assert not found.is_everywhere
    assert found.sigmas.max() < 1.5 * found.shuffled_sigmas.max()


def test_a_picture_that_never_changes_is_not_coherent() -> None:
    found = Fluctuation.measure(frames(0.0, count=1) * 30, np.random.default_rng(0))
    assert not found.is_everywhere
    assert np.abs(found.sigmas).max() < 0.01


def test_noise_that_stays_for_some_frames_is_noticed() -> None:
    assert Fluctuation.measure(frames(0.0, held=4), np.random.default_rng(0)).is_everywhere


def test_light_that_changes_moves_nothing() -> None:
    steady = frames(0.0)
    flicker = 1 + 0.2 * np.sin(np.arange(60) / 5)
    lit = [
        np.clip(np.rint(image * gain), 0, 255).astype(np.uint8)
        for image, gain in zip(steady, flicker, strict=True)
    ]
    found = Fluctuation.measure(lit, np.random.default_rng(0))
    assert not found.is_everywhere
    assert found.sigmas.max() < 1.5 * found.shuffled_sigmas.max()


def test_the_longest_run_is_taken() -> None:
    times_s = np.array([0.0, 1.0, 1.1, 1.2, 1.3, 2.0, 2.1, 5.0])
    assert longest_run(times_s, 0.12) == slice(1, 5)
    assert longest_run(np.arange(5.0), 0.12) == slice(0, 1)


def test_what_swings_in_place_oscillates_and_what_travels_by_does_not() -> None:
    inside, far = plume(), np.zeros_like(plume())
    far[:, :60] = True
    swings = Fluctuation.measure(frames(0.3, springs=True), np.random.default_rng(0))
    passes = Fluctuation.measure(frames(0.3), np.random.default_rng(0))
    assert swings.oscillates(inside)
    assert not passes.oscillates(inside)
    assert not swings.oscillates(far)
