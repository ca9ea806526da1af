"""What a survey answers, in the terms of its file."""

from collections.abc import Sequence

import numpy as np

from geometry.arrays import FloatArray, IntArray
from geometry.georeference import HeightDatum
from locate.survey.associate import Fused
from locate.survey.coverage import Looks
from locate.survey.findings import Hotspot, Sighting, matrix, vector
from locate.survey.frame import Seen
from locate.survey.model import Flight, Survey
from locate.survey.occurrence import hotspot_counts

SOLAR_TIME = "Hours are mean solar time, from UTC and the longitude, within a quarter of an hour."
RECORDER_TIME = (
    "Where a flight's telemetry has only the recorder's own clock, hours are as it says: time zone "
    "and summer time can put them an hour or two from solar time."
)
NO_TIME = "Some flights do not say when they were; they count in all hours together only."
NO_HEIGHTS = "Flights count heights from different levels: heights are weak."


def hotspots_of(
    seen: Sequence[Seen],
    fused: Fused,
    looks: Sequence[Looks | None],
    labels: Sequence[str],
    begun: Survey,
) -> tuple[Hotspot, ...]:
    """The hotspots in the order of their numbers.

    Args:
        seen: The sightings.
        fused: What became of them.
        looks: Of each flight.
        labels: Season and hours of each flight.
        begun: The survey so far.
    """
    return tuple(
        _hotspot(number, k, seen, fused, looks, labels, begun)
        for number, k in enumerate(ranking(fused), start=1)
    )


def ranking(fused: Fused) -> IntArray:
    """(K,) indices of the hotspots, most often seen first."""
    counts = np.bincount(fused.hotspot_of, minlength=len(fused.solved.positions))
    return np.argsort(-counts, kind="stable")


def _hotspot(
    number: int,
    k: int,
    seen: Sequence[Seen],
    fused: Fused,
    looks: Sequence[Looks | None],
    labels: Sequence[str],
    begun: Survey,
) -> Hotspot:
    members = [one for one, group in zip(seen, fused.hotspot_of, strict=True) if group == k]
    position, weakest_px = fused.solved.positions[k], begun.column.displacement_px
    saw = {one.flight for one in members}
    looked = [
        index
        for index, one in enumerate(looks)
        if index in saw or limit_at(one, position, begun.settings.cell_m) <= weakest_px
    ]
    axis = np.mean([one.axis for one in members], axis=0)
    doubt = np.prod([1 - one.plume.probability for one in members])
    return Hotspot(
        id=number,
        position=vector(position),
        covariance=matrix(fused.solved.covariances[k]),
        axis=vector(axis / np.linalg.norm(axis)),
        displacement_px=float(np.mean([one.plume.displacement_px for one in members])),
        probability=float(1 - doubt),
        looked_by=tuple(begun.mapped[i].name for i in looked),
        occurrence=hotspot_counts([labels[i] for i in looked], [labels[i] for i in sorted(saw)]),
    )


def limit_at(one: Looks | None, position: FloatArray, cell_m: float) -> float:
    """Px of the weakest column that a flight would have found at a place."""
    if one is None:
        return np.inf
    column, row = (np.floor(position[:2] / cell_m).astype(int) - one.low).tolist()
    rows, columns = one.limit_px.shape
    return float(one.limit_px[row, column]) if 0 <= row < rows and 0 <= column < columns else np.inf


def sightings_in(
    seen: Sequence[Seen], fused: Fused, leans: FloatArray, flights: Sequence[Flight]
) -> tuple[Sighting, ...]:
    """Every sighting with the number of its hotspot."""
    positions, unsure = fused.solved.common.corrected(seen, leans)
    number = np.argsort(ranking(fused)) + 1
    return tuple(
        Sighting(
            flight=flights[one.flight].name,
            plume=one.plume.id,
            hotspot=int(number[fused.hotspot_of[i]]),
            position=vector(one.position),
            corrected=vector(positions[i]),
            covariance=matrix(one.own + unsure[i]),
            weight=float(fused.solved.weights[i]),
        )
        for i, one in enumerate(seen)
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
