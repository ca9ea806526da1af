"""What a survey finds: hotspots, the sightings they were made of, and the wind."""

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, FiniteFloat

from geometry.arrays import FloatArray

Vector = tuple[FiniteFloat, FiniteFloat, FiniteFloat]
Matrix = tuple[Vector, Vector, Vector]


class SurveyBlock(BaseModel):
    """A part of survey.json: as read it stays, and it holds nothing that is not known."""

    model_config = ConfigDict(extra="forbid", frozen=True)


class OccurrenceCount(SurveyBlock):
    """How often something was seen in one season and part of the day.

    Attributes:
        bin: Label of the season and the hours; ``"all"`` for everything.
        looked: Number of flights that would have detected it.
        seen: Number of those that did.
        probability: That it is present, posterior mean.
        low: 5 % quantile of that.
        high: 95 % quantile.
    """

    bin: str
    looked: float
    seen: float
    probability: float = Field(ge=0, le=1)
    low: float = Field(ge=0, le=1)
    high: float = Field(ge=0, le=1)


class SightingRecord(SurveyBlock):
    """A plume of one flight, in the frame of the survey.

    Attributes:
        flight: Name of the flight.
        plume: Its number in that flight's map.
        hotspot: The hotspot it belongs to.
        position: As the flight states it.
        corrected: With the flight's estimated offset taken out.
        covariance: Of `corrected`.
        weight: From 0, an outlier, to 1: what it counts in its hotspot.
    """

    flight: str
    plume: int
    hotspot: int
    position: Vector
    corrected: Vector
    covariance: Matrix
    weight: float = Field(ge=0, le=1)


class Hotspot(SurveyBlock):
    """A place that sends up columns of air.

    Attributes:
        id: From 1, most often seen first.
        position: East, north, up (m) in the frame of the survey: the foot of its column in the
            mean lean of all flights.
        covariance: Of `position`.
        axis: Unit vector of the mean rise.
        displacement_px: Mean of its sightings.
        probability: That at least one of its sightings is no false alarm.
        looked_by: Names of the flights that covered it, those that saw it included.
        occurrence: How often it was present: all flights first, then by season and hours.
    """

    id: int
    position: Vector
    covariance: Matrix
    axis: Vector
    displacement_px: FiniteFloat
    probability: float = Field(ge=0, le=1)
    looked_by: tuple[str, ...]
    occurrence: tuple[OccurrenceCount, ...]


class Wind(SurveyBlock):
    """How far columns lean, from the axes of one flight's plumes.

    Attributes:
        flight: Name of the flight.
        lean: Metres to the east and the north per metre of rise.
        sigma: Standard deviation of either.
        from_deg: Where the wind comes from, clockwise from north.
    """

    flight: str
    lean: tuple[FiniteFloat, FiniteFloat]
    sigma: FiniteFloat
    from_deg: FiniteFloat


def plain_vector(values: FloatArray) -> Vector:
    """Three plain numbers."""
    x, y, z = np.asarray(values, dtype=float).tolist()
    return x, y, z


def plain_matrix(values: FloatArray) -> Matrix:
    """Three by three plain numbers."""
    first, second, third = values
    return plain_vector(first), plain_vector(second), plain_vector(third)
