import numpy as np
import pytest

from geometry.errors import BadInputError
from geometry.refraction import (
    AMBIENT_TEMPERATURE_K,
    density_deficit,
    expected_displacement_px,
    gaussian_column_deflection,
    lever_px,
    refractivity,
    temperature_rise_k,
)

VIEW = {"radius_m": 0.2, "range_to_plume_m": 8.0, "range_to_background_m": 16.0, "focal_px": 560.0}


def test_air_is_as_the_design_says():
    assert float(refractivity()) == pytest.approx(2.77e-4, rel=3e-3)


def test_density_follows_the_gas_law():
    cold, hot = refractivity(temperature_k=300.0), refractivity(temperature_k=600.0)
    assert float(cold / hot) == pytest.approx(2.0)
    thin = refractivity(temperature_k=300.0, pressure_pa=50662.5)
    assert float(cold / thin) == pytest.approx(2.0)


@pytest.mark.parametrize(
    ("gas", "rises", "bends_more_than_air"),
    [
        ("methane", True, True),
        ("propane", False, True),
        ("hydrogen", True, False),
        ("helium", True, False),
        ("co2", False, True),
        ("sf6", False, True),
    ],
)
def test_gases_rise_and_bend_as_they_do(gas, rises, bends_more_than_air):
    assert (density_deficit(gas, 1.0, AMBIENT_TEMPERATURE_K) > 0) == rises
    assert (refractivity(gas) > refractivity()) == bends_more_than_air
    half = refractivity(gas, 0.5)
    assert float(half) == pytest.approx(float(refractivity(gas) + refractivity()) / 2)


def test_gaussian_deflection_is_the_gradient_integral():
    delta_n, radius, offset = -1e-4, 0.2, 0.13
    s = np.linspace(-3, 3, 20001)
    gradient = -offset / radius**2 * delta_n * np.exp(-(offset**2 + s**2) / (2 * radius**2))
    eps = gaussian_column_deflection(offset, delta_n=delta_n, radius_m=radius)
    assert float(eps) == pytest.approx(np.trapezoid(gradient, s), rel=1e-6)
    assert eps > 0


def test_deflection_turns_to_the_denser_side():
    heavy = gaussian_column_deflection([-0.1, 0.1], delta_n=1e-4, radius_m=0.2)
    assert heavy[0] > 0 > heavy[1]


def test_expected_displacement_is_the_peak_of_the_profile():
    hot = refractivity(temperature_k=400.0) - refractivity()
    offsets = np.linspace(-1, 1, 4001)
    eps = gaussian_column_deflection(offsets, delta_n=float(hot), radius_m=0.2)
    expected = 560.0 * 0.5 * np.abs(eps).max()
    assert expected_displacement_px(temperature_k=400.0, **VIEW) == pytest.approx(
        expected, rel=1e-4
    )


def test_window_narrows_what_is_seen():
    radius_px = 560.0 * 0.2 / 8.0
    full = expected_displacement_px(temperature_k=400.0, **VIEW)
    half = expected_displacement_px(temperature_k=400.0, window_px=radius_px, **VIEW)
    assert half == pytest.approx(full / 2)


@pytest.mark.parametrize("rise_k", [1.0, 50.0, 400.0])
def test_temperature_inverts_displacement(rise_k):
    seen = expected_displacement_px(
        temperature_k=AMBIENT_TEMPERATURE_K + rise_k, window_px=3.0, **VIEW
    )
    assert temperature_rise_k(seen, window_px=3.0, **VIEW) == pytest.approx(rise_k)


def test_no_temperature_bends_without_limit():
    assert temperature_rise_k(100.0, **VIEW) == np.inf


def test_bad_input_is_named():
    with pytest.raises(BadInputError, match="'steam'"):
        refractivity("steam")
    with pytest.raises(BadInputError, match="behind the plume"):
        lever_px(range_to_plume_m=9.0, range_to_background_m=8.0, focal_px=560.0)
