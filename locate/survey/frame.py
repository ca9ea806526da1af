"""The one frame of a survey, and the sightings of each flight in it."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from geometry.arrays import FloatArray
from geometry.georeference import Alignment, Georeference, HeightDatum
from geometry.georeference.constraints import point_jacobian
from geometry.similarity import Similarity
from locate.map.plume import Plume
from locate.survey.model import Flight

UNKNOWN_HEIGHT_M = 100.0
"""Standard deviation added where heights of flights cannot be compared; chosen."""
LEAST_OWN_M = 0.01
"""Smallest standard deviation of a sighting without its offset; chosen."""


@dataclass(frozen=True, kw_only=True)
class FlightOffset:
    """How far one flight's frame may be off, shared by all that it saw.

    Attributes:
        flight: Its name.
        survey_from_flight: From its frame to the survey's: a rigid motion, since both are
            tangent to one ellipsoid.
        covariance: (7, 7) in the left tangent of the flight's frame: [rotation (rad), translation
            (m), log scale].
    """

    flight: str
    survey_from_flight: Similarity
    covariance: FloatArray

    def jacobian(self, positions_in_survey: FloatArray) -> FloatArray:
        """(N, 3, 7) derivative of (N, 3) survey points by the tangent."""
        in_flight = self.survey_from_flight.inverse()(np.reshape(positions_in_survey, (-1, 3)))
        return np.asarray(self.survey_from_flight.rotation @ point_jacobian(in_flight))


@dataclass(frozen=True, kw_only=True)
class PlumeSighting:
    """A plume of one flight in the frame of the survey.

    Attributes:
        flight: Index of the flight among those that are mapped.
        plume: As in its map, which is in the flight's frame.
        position: (3,) its source.
        own_covariance: (3, 3) covariance without the flight's offset, m squared.
        offset_jacobian: (3, 7) derivative of `position` by the flight's offset.
        axis: (3,) unit vector of the rise.
    """

    flight: int
    plume: Plume
    position: FloatArray
    own_covariance: FloatArray
    offset_jacobian: FloatArray
    axis: FloatArray


def offset_of(flight: Flight, frame: Georeference) -> FlightOffset:
    """Where a flight's frame lies in the survey's, with its uncertainty.

    Heights that count from something else than the survey's are not comparable, and heights over
    take-off never are: the flight's height is left free then.
    """
    own = flight.georeference
    corners = frame.to_enu(own.lat_lon_height(np.vstack([np.zeros(3), np.eye(3)])))
    survey_from_flight = Similarity(
        scale=1.0, rotation=(corners[1:] - corners[0]).T, translation=corners[0]
    )
    covariance = Alignment.from_dict(flight.plume_map.georeference or {}).covariance.copy()
    if own.datum != frame.datum or own.datum is HeightDatum.TAKEOFF:
        covariance[5, 5] += UNKNOWN_HEIGHT_M**2
    return FlightOffset(
        flight=flight.name, survey_from_flight=survey_from_flight, covariance=covariance
    )


def sightings_of(flights: Sequence[Flight], offsets: Sequence[FlightOffset]) -> list[PlumeSighting]:
    """Every plume of every flight; what the offset adds to its covariance is taken out again."""
    return [
        _make_sighting(index, plume, flight, offset)
        for index, (flight, offset) in enumerate(zip(flights, offsets, strict=True))
        for plume in flight.plume_map.plumes
    ]


def _make_sighting(index: int, plume: Plume, flight: Flight, offset: FlightOffset) -> PlumeSighting:
    alignment = Alignment.from_dict(flight.plume_map.georeference or {})
    added = alignment.position_covariances(plume.source)[0]
    values, vectors = np.linalg.eigh(plume.source_covariance - added)
    own = (vectors * np.maximum(values, LEAST_OWN_M**2)) @ vectors.T
    position = offset.survey_from_flight(plume.source)
    return PlumeSighting(
        flight=index,
        plume=plume,
        position=position,
        own_covariance=offset.survey_from_flight.transform_covariance(own),
        offset_jacobian=offset.jacobian(position)[0],
        axis=offset.survey_from_flight.rotation @ plume.axis,
    )
