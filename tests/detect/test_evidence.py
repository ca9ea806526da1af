import numpy as np
import pytest

from detect.evidence import LLR_MAX, LLR_MIN, displacement_evidence, log_likelihood_ratio

SHAPE = (120, 160)


def noise(sigma: float, seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).normal(0, sigma, (*SHAPE, 2)).astype(np.float32)


def flat(value: float) -> np.ndarray:
    return np.full(SHAPE, value, np.float32)


def test_the_ratio_rises_with_the_displacement_and_falls_with_its_sigma() -> None:
    sizes = np.linspace(0, 1, 50).astype(np.float32)
    ratio = log_likelihood_ratio(sizes, np.full(50, 0.1, np.float32))
    assert ratio[0] < 0 < ratio[25]
    assert (np.diff(ratio[:30]) > 0).all()
    unsure = log_likelihood_ratio(sizes, np.full(50, 0.5, np.float32))
    assert (unsure[15:] < ratio[15:]).all()


def test_the_densities_are_densities() -> None:
    """The expected likelihood ratio under the null is one."""
    rng = np.random.default_rng(1)
    n = 200_000
    t = rng.normal(size=(n, 2)) / np.sqrt(rng.chisquare(3, n) / 3)[:, None]
    ratio = log_likelihood_ratio(
        (0.3 * np.linalg.norm(t, axis=1)).astype(np.float32), np.full(n, 0.3, np.float32)
    )
    assert np.exp(ratio).mean() == pytest.approx(1, abs=0.03)


def test_noise_is_evidence_against_and_a_patch_for() -> None:
    w = noise(0.05)
    w[40:70, 60:90, 0] += 0.5
    llr, _ = displacement_evidence(w, flat(0.05), flat(50), flat(1))
    assert llr[45:65, 65:85].mean() > 1.5
    assert llr[:30].mean() < -0.3
    assert llr.max() <= LLR_MAX
    assert llr.min() >= LLR_MIN


def test_a_thin_line_counts_less_than_a_patch() -> None:
    w = noise(0.05)
    w[:, 30] += 0.5
    w[40:70, 60:90] += 0.5
    llr, _ = displacement_evidence(w, flat(0.05), flat(50), flat(1))
    assert llr[:, 30].mean() < llr[45:65, 65:85].mean() / 2


def test_sigma_is_fitted_to_the_frame() -> None:
    _, sigma_px = displacement_evidence(noise(0.2), flat(0.05), flat(50), flat(1))
    assert np.median(sigma_px) == pytest.approx(0.2, rel=0.05)
    _, capped = displacement_evidence(noise(0.2), flat(0.05), flat(50), flat(1), largest_scale=2.0)
    assert capped.max() == pytest.approx(0.1)


def test_what_was_not_measured_says_nothing() -> None:
    sigma_px, texture, trust = flat(0.05), flat(50), flat(1)
    sigma_px[:20], texture[20:40], trust[40:60] = np.inf, 0, 0
    llr, _ = displacement_evidence(noise(0.5), sigma_px, texture, trust)
    assert not llr[:60].any()
    assert np.isfinite(llr).all()
