"""How air bends light: refractivity of gases, deflection by a plume, and its size in pixels.

Gladstone-Dale: `n - 1 = K * rho`, so at fixed composition it scales with pressure over temperature,
and a mixture's refractivity is the mole-fraction mean of its parts.
"""

from math import exp, inf, pi, sqrt

import numpy as np
from numpy.typing import ArrayLike

from geometry.arrays import FloatArray
from geometry.errors import BadInputError

STANDARD_TEMPERATURE_K = 273.15
STANDARD_PRESSURE_PA = 101325.0
AMBIENT_TEMPERATURE_K = 288.0
"""Temperature of the surroundings where none is given, 15 degrees C."""

REFRACTIVITY_AT_STANDARD = {
    "air": 2.926e-4,
    "methane": 4.44e-4,
    "propane": 1.08e-3,
    "hydrogen": 1.39e-4,
    "helium": 3.49e-5,
    "co2": 4.49e-4,
    "sf6": 7.83e-4,
}
"""n - 1 at 589 nm, 273.15 K, 101325 Pa.

Air: Ciddor, Appl. Opt. 35 (1996). Hydrogen: Peck and Huang, J. Opt. Soc. Am. 67 (1977). Helium:
Mansfield and Peck, J. Opt. Soc. Am. 59 (1969). CO2: Bideau-Mehu et al., Opt. Commun. 9 (1973).
Methane, propane, SF6: Kaye and Laby, Tables of Physical and Chemical Constants, section 2.5.7
(propane and SF6 to about 1 %).
"""

MOLAR_MASS_KG = {
    "air": 28.96e-3,
    "methane": 16.04e-3,
    "propane": 44.10e-3,
    "hydrogen": 2.016e-3,
    "helium": 4.003e-3,
    "co2": 44.01e-3,
    "sf6": 146.06e-3,
}


def _of_gas(table: dict[str, float], gas: str) -> float:
    try:
        return table[gas]
    except KeyError:
        raise BadInputError(f"gas {gas!r} is unknown, use one of {', '.join(table)}") from None


def refractivity(
    gas: str = "air",
    mole_fraction: ArrayLike = 1.0,
    temperature_k: ArrayLike = AMBIENT_TEMPERATURE_K,
    pressure_pa: float = STANDARD_PRESSURE_PA,
) -> FloatArray:
    """N - 1 of `gas` mixed with air, as an ideal gas, at 589 nm.

    Args:
        gas: A key of `REFRACTIVITY_AT_STANDARD`.
        mole_fraction: Share of `gas`, 0 to 1; the rest is air. Any shape.
        temperature_k: Of the mixture, broadcast against `mole_fraction`.
        pressure_pa: Of the mixture.

    Raises:
        BadInputError: The gas is unknown.
    """
    share = np.asarray(mole_fraction, dtype=float)
    air = REFRACTIVITY_AT_STANDARD["air"]
    at_standard = air + share * (_of_gas(REFRACTIVITY_AT_STANDARD, gas) - air)
    density_ratio = STANDARD_TEMPERATURE_K / np.asarray(temperature_k, dtype=float)
    return np.asarray(at_standard * density_ratio * (pressure_pa / STANDARD_PRESSURE_PA))


def density_deficit(gas: str, mole_fraction: float, temperature_k: float) -> float:
    """`1 - rho / rho_ambient` of a gas in air at `AMBIENT_TEMPERATURE_K`: positive means it rises.

    Raises:
        BadInputError: The gas is unknown.
    """
    air = MOLAR_MASS_KG["air"]
    mass = air + mole_fraction * (_of_gas(MOLAR_MASS_KG, gas) - air)
    return 1.0 - mass / air * AMBIENT_TEMPERATURE_K / temperature_k


def gaussian_column_deflection(
    offset_m: ArrayLike, *, delta_n: float, radius_m: float
) -> FloatArray:
    """Deflection of a ray that crosses a Gaussian column square to its axis.

    The column is `n = n0 + delta_n * exp(-r^2 / (2 radius_m^2))` with n0 = 1; the integral of its
    gradient along the ray, `eps = (1/n0) * integral(dn/dx ds)`, is closed.

    Args:
        offset_m: Signed distance from the axis at which the ray passes, any shape.
        delta_n: Refractive index on the axis less that of the surroundings.
        radius_m: Standard deviation of the profile.

    Returns:
        Deflection in rad along `offset_m`, positive away from the axis.
    """
    x = np.asarray(offset_m, dtype=float) / radius_m
    return np.asarray(-delta_n * sqrt(2 * pi) * x * np.exp(-(x**2) / 2))


def lever_px(*, range_to_plume_m: float, range_to_background_m: float, focal_px: float) -> float:
    """Displacement in px per rad of deflection, `f * (Z_b - Z_p) / Z_b`.

    Raises:
        BadInputError: The background is not behind the plume.
    """
    if not 0 < range_to_plume_m < range_to_background_m:
        raise BadInputError(
            f"background at {range_to_background_m} m must lie behind the plume "
            f"at {range_to_plume_m} m"
        )
    return focal_px * (1.0 - range_to_plume_m / range_to_background_m)


def _peak_px_per_delta_n(
    *,
    radius_m: float,
    range_to_plume_m: float,
    range_to_background_m: float,
    focal_px: float,
    window_px: float,
) -> float:
    lever = lever_px(
        range_to_plume_m=range_to_plume_m,
        range_to_background_m=range_to_background_m,
        focal_px=focal_px,
    )
    radius_px = focal_px * radius_m / range_to_plume_m
    seen = radius_px**2 / (radius_px**2 + window_px**2)
    return lever * sqrt(2 * pi) * exp(-0.5) * seen


def expected_displacement_px(
    *,
    radius_m: float,
    range_to_plume_m: float,
    range_to_background_m: float,
    focal_px: float,
    gas: str = "air",
    mole_fraction: float = 1.0,
    temperature_k: float = AMBIENT_TEMPERATURE_K,
    window_px: float = 0.0,
) -> float:
    """Largest displacement that a Gaussian column shows, at one radius from its axis.

    The peak does not depend on the radius (a wider column has a longer path and a gentler gradient)
    until the column gets as narrow as the window in which the displacement is measured.

    Args:
        radius_m: Standard deviation of the column.
        range_to_plume_m: Distance along the optical axis.
        range_to_background_m: Distance along the optical axis; may be inf.
        focal_px: Focal length.
        gas: Gas in the column.
        mole_fraction: Its share on the axis.
        temperature_k: Temperature on the axis; the surroundings are at `AMBIENT_TEMPERATURE_K`.
        window_px: Standard deviation of the Gaussian window of the measurement.

    Raises:
        BadInputError: The gas is unknown, or the background is not behind the plume.
    """
    delta_n = refractivity(gas, mole_fraction, temperature_k) - refractivity()
    return abs(float(delta_n)) * _peak_px_per_delta_n(
        radius_m=radius_m,
        range_to_plume_m=range_to_plume_m,
        range_to_background_m=range_to_background_m,
        focal_px=focal_px,
        window_px=window_px,
    )


def temperature_rise_k(
    displacement_px: float,
    *,
    radius_m: float,
    range_to_plume_m: float,
    range_to_background_m: float,
    focal_px: float,
    window_px: float = 0.0,
) -> float:
    """The rise over ambient that a hot-air column needs to show `displacement_px`.

    The inverse of `expected_displacement_px`; inf where no temperature is high enough.

    Raises:
        BadInputError: The background is not behind the plume.
    """
    per_delta_n = _peak_px_per_delta_n(
        radius_m=radius_m,
        range_to_plume_m=range_to_plume_m,
        range_to_background_m=range_to_background_m,
        focal_px=focal_px,
        window_px=window_px,
    )
    lost = displacement_px / per_delta_n / float(refractivity())
    return AMBIENT_TEMPERATURE_K * lost / (1.0 - lost) if lost < 1.0 else inf
