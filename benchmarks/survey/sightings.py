"""What a simulated flight reports: sightings in a frame that is off as a whole."""

import numpy as np

from geometry.arrays import FloatArray
from geometry.georeference.constraints import point_jacobian
from geometry.similarity import Similarity
from locate.map.plume import Plume
from locate.survey.frame import FlightOffset, PlumeSighting

UPRIGHT = np.array([0.0, 0.0, 1.0])


def offset_of(flight: int, sigmas: FloatArray) -> FlightOffset:
    """Of a flight's frame: nothing, known to (7,) sigmas of turn, shift and scale."""
    unmoved = Similarity(scale=1.0, rotation=np.eye(3), translation=np.zeros(3))
    return FlightOffset(
        flight=str(flight), survey_from_flight=unmoved, covariance=np.diag(sigmas**2)
    )


def sighting(
    flight: int, foot: FloatArray, offset: FloatArray, own_m: float, rng: np.random.Generator
) -> PlumeSighting:
    """A column at `foot`, seen in a frame off by `offset` (7,) with an error of its own."""
    position = foot + point_jacobian(foot[None])[0] @ offset + rng.normal(0, own_m, 3)
    return PlumeSighting(
        flight=flight,
        plume=plume_at(position),
        position=position,
        own_covariance=own_m**2 * np.eye(3),
        offset_jacobian=point_jacobian(position[None])[0],
        axis=UPRIGHT,
    )


def plume_at(source: FloatArray) -> Plume:
    return Plume(
        id=1,
        source=source,
        source_covariance=np.eye(3),
        axis=UPRIGHT,
        axis_sigma_rad=0.02,
        extent_low=0.0,
        extent_high=10.0,
        radius_by_height=np.zeros((0, 2)),
        evidence_nats=30.0,
        probability=0.99,
        views=(),
        displacement_px=0.5,
    )
