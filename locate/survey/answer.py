"""Hotspots, sightings and notes of a survey, as its file holds them."""

from collections.abc import Sequence

import numpy as np

from geometry.arrays import FloatArray, IntArray
from geometry.georeference import HeightDatum
from locate.survey.associate import AssociatedHotspots
from locate.survey.coverage import FlightCoverage
from locate.survey.findings import Hotspot, SightingRecord, plain_matrix, plain_vector
from locate.survey.frame import PlumeSighting
from locate.survey.model import Flight, Survey
from locate.survey.occurrence import hotspot_counts

SOLAR_TIME = "Hours are mean solar time, from UTC and the longitude, within a quarter of an hour."
RECORDER_TIME = (
    "Where a flight's telemetry has only the recorder's own clock, hours are those of that clock: "
    "time zone and summer time can put them an hour or two from solar time."
)
NO_TIME = "The time of some flights is not known; they count in all hours together only."
NO_HEIGHTS = "Flights count heights from different levels: heights are weak."


def hotspots_of(
    sightings: Sequence[PlumeSighting],
    associated: AssociatedHotspots,
    coverages: Sequence[FlightCoverage | None],
    labels: Sequence[str],
    begun: Survey,
) -> tuple[Hotspot, ...]:
    """The hotspots in the order of their numbers.

    Args:
        sightings: Those of all flights.
        associated: Their hotspots.
        coverages: Of each flight; None where it is not known.
        labels: Season and hours of each flight.
        begun: The survey with its settings, flights and reference column.
    """
    return tuple(
        _make_hotspot(number, k, sightings, associated, coverages, labels, begun)
        for number, k in enumerate(rank_hotspots(associated), start=1)
    )


def rank_hotspots(associated: AssociatedHotspots) -> IntArray:
    """(K,) indices of the hotspots, most often seen first."""
    counts = np.bincount(associated.hotspot_of, minlength=len(associated.solution.positions))
    return np.argsort(-counts, kind="stable")


def _make_hotspot(
    number: int,
    k: int,
    sightings: Sequence[PlumeSighting],
    associated: AssociatedHotspots,
    coverages: Sequence[FlightCoverage | None],
    labels: Sequence[str],
    begun: Survey,
) -> Hotspot:
    members = [
        one for one, group in zip(sightings, associated.hotspot_of, strict=True) if group == k
    ]
    position, weakest_px = associated.solution.positions[k], begun.column.displacement_px
    detected_by = {one.flight for one in members}
    covering = [
        index
        for index, one in enumerate(coverages)
        if index in detected_by or limit_at(one, position, begun.settings.cell_m) <= weakest_px
    ]
    axis = np.mean([one.axis for one in members], axis=0)
    doubt = np.prod([1 - one.plume.probability for one in members])
    return Hotspot(
        id=number,
        position=plain_vector(position),
        covariance=plain_matrix(associated.solution.covariances[k]),
        axis=plain_vector(axis / np.linalg.norm(axis)),
        displacement_px=float(np.mean([one.plume.displacement_px for one in members])),
        probability=float(1 - doubt),
        looked_by=tuple(begun.mapped[i].name for i in covering),
        occurrence=hotspot_counts(
            [labels[i] for i in covering], [labels[i] for i in sorted(detected_by)]
        ),
    )


def limit_at(one: FlightCoverage | None, position: FloatArray, cell_m: float) -> float:
    """The weakest column, px, that a flight would have detected at a place."""
    if one is None:
        return np.inf
    column, row = (np.floor(position[:2] / cell_m).astype(int) - one.low).tolist()
    rows, columns = one.limit_px.shape
    return float(one.limit_px[row, column]) if 0 <= row < rows and 0 <= column < columns else np.inf


def sightings_in(
    sightings: Sequence[PlumeSighting],
    associated: AssociatedHotspots,
    leans: FloatArray,
    flights: Sequence[Flight],
) -> tuple[SightingRecord, ...]:
    """Every sighting with the number of its hotspot."""
    positions, unsure = associated.solution.shared.correct_positions(sightings, leans)
    number = np.argsort(rank_hotspots(associated)) + 1
    return tuple(
        SightingRecord(
            flight=flights[one.flight].name,
            plume=one.plume.id,
            hotspot=int(number[associated.hotspot_of[i]]),
            position=plain_vector(one.position),
            corrected=plain_vector(positions[i]),
            covariance=plain_matrix(one.own_covariance + unsure[i]),
            weight=float(associated.solution.weights[i]),
        )
        for i, one in enumerate(sightings)
    )


def notes_of(begun: Survey) -> tuple[str, ...]:
    """What a reader must know of the flights."""
    notes = [
        f"{flight.name} is left out: {flight.failure}."
        for flight in begun.flights
        if flight.failure is not None
    ]
    bases = {None if flight.moment is None else flight.moment.basis for flight in begun.mapped}
    if "UTC" in bases:
        notes.append(SOLAR_TIME)
    if "recorder" in bases:
        notes.append(RECORDER_TIME)
    if None in bases:
        notes.append(NO_TIME)
    datums = {flight.georeference.datum for flight in begun.mapped}
    if len(datums) > 1 or HeightDatum.TAKEOFF in datums:
        notes.append(NO_HEIGHTS)
    return tuple(notes)
