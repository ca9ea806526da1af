"""How the mean of a turbulent plume widens and thins on its way up (or down, where it is heavy).

Similarity of round plumes: the profile is Gaussian and widens in proportion to the height, and the
share of the source's fluid on the axis falls with its power -5/3. Constants: Fischer et al.,
*Mixing in Inland and Coastal Waters* (1979), section 9.2.
"""

from dataclasses import dataclass
from math import inf, sqrt
from typing import Self

import numpy as np
from numpy.typing import ArrayLike

from geometry.arrays import FloatArray
from geometry.errors import BadInputError
from geometry.refraction import (
    MOLAR_MASS_KG,
    STANDARD_PRESSURE_PA,
    density_deficit,
)

GRAVITY_MPS2 = 9.81
MOLAR_GAS_CONSTANT = 8.314
SPREAD = 0.12 / sqrt(2)
"""Standard deviation of the profile of what the source gave off, over the height."""
AXIS_BUOYANCY = 9.1
"""Reduced gravity on the axis over `flux^(2/3) height^(-5/3)`."""
THINNING = 5 / 3
LEAST_DEFICIT = 1e-3
"""Of density, relative: with less it is carried by its speed and the wind, not by its weight."""


@dataclass(frozen=True, kw_only=True)
class RisingPlume:
    """The mean of a plume by height.

    Attributes:
        radius_m: Standard deviation of the profile at the source.
        spread: What each metre of height adds to it; 0 is a straight column that thins nowhere.
    """

    radius_m: float
    spread: float = SPREAD

    @classmethod
    def of_source(cls, radius_m: float) -> Self:
        """What rises from a disc of this radius: a profile that covers the same area."""
        return cls(radius_m=radius_m / sqrt(2))

    @classmethod
    def of_leak(
        cls, rate_kgps: float, *, gas: str, mole_fraction: float, temperature_k: float
    ) -> Self:
        """What becomes of a leak whose own speed is soon lost; the size of the hole is no matter.

        Args:
            rate_kgps: Mass that leaves in a second.
            gas: Of the leak, see `geometry.refraction`.
            mole_fraction: Its share, the rest is air.
            temperature_k: At the source.

        Raises:
            BadInputError: The gas is unknown, or weighs what air does.
        """
        deficit = abs(density_deficit(gas, mole_fraction, temperature_k))
        if deficit < LEAST_DEFICIT:
            raise BadInputError(
                f"{gas} at {temperature_k:.0f} K weighs what the air around it does, so its leak "
                "rate does not tell how it spreads; give the radius of its source"
            )
        air = MOLAR_MASS_KG["air"]
        mass = air + mole_fraction * (MOLAR_MASS_KG[gas] - air)
        density = mass * STANDARD_PRESSURE_PA / (MOLAR_GAS_CONSTANT * temperature_k)
        reduced_gravity = GRAVITY_MPS2 * deficit
        flux = reduced_gravity * rate_kgps / density
        origin_m = (AXIS_BUOYANCY * flux ** (2 / 3) / reduced_gravity) ** (1 / THINNING)
        return cls(radius_m=SPREAD * origin_m)

    def radius_at(self, height_m: ArrayLike) -> FloatArray:
        """Standard deviation of the profile, m."""
        return np.asarray(self.radius_m + self.spread * np.asarray(height_m, dtype=float))

    def share_at(self, height_m: ArrayLike) -> FloatArray:
        """Share of the source's fluid on the axis, 1 at the source."""
        origin_m = self.radius_m / self.spread if self.spread else inf
        return np.asarray((1 + np.asarray(height_m, dtype=float) / origin_m) ** -THINNING)
