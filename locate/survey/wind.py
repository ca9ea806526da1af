"""The wind, from how far the plumes of a flight lean."""

from collections.abc import Sequence

import numpy as np

from geometry.arrays import FloatArray
from geometry.georeference import Alignment
from locate.survey.findings import Wind
from locate.survey.frame import PlumeSighting
from locate.survey.model import Flight

STEEPEST_UP = 0.2
"""Vertical part of an axis below which a plume lies too flat to state a lean; chosen."""


def wind_of(flight: Flight, sightings: Sequence[PlumeSighting]) -> Wind | None:
    """The mean lean of one flight's plumes; None where it has none that rises.

    The tilt of the flight's frame is common to its plumes and does not average out.

    Args:
        flight: The flight.
        sightings: Its plumes.
    """
    rising = [one for one in sightings if one.axis[2] > STEEPEST_UP]
    if not rising:
        return None
    leans = np.array([lean_of(one.axis) for one in rising])
    sigmas = np.array([one.plume.axis_sigma_rad / one.axis[2] ** 2 for one in rising])
    tilt = Alignment.from_dict(flight.plume_map.georeference or {}).tilt_sigma_rad
    own = np.maximum(sigmas**2 - tilt**2, 1e-6)
    weights = 1 / own
    mean = weights @ leans / weights.sum()
    scatter = weights @ ((leans - mean) ** 2).mean(axis=1) / weights.sum()
    # Few plumes: what they state; many: how they scatter, if that is more.
    spread = max(1 / weights.sum(), float(scatter) / max(len(rising) - 1, 1))
    east, north = mean.tolist()
    return Wind(
        flight=flight.name,
        lean=(east, north),
        sigma=float(np.sqrt(spread + tilt**2)),
        from_deg=float(np.degrees(np.arctan2(-east, -north)) % 360),
    )


def lean_of(axis: FloatArray) -> FloatArray:
    """(2,) metres to the east and the north per metre of rise."""
    return np.asarray(axis[:2] / axis[2])
