"""Flights joined: the hotspots, winds and cells that all of them show together."""

from collections.abc import Sequence

import numpy as np

from geometry.arrays import FloatArray
from locate import __version__
from locate.survey.answer import hotspots_of, notes_of, sightings_in
from locate.survey.associate import AssociatedHotspots, associate
from locate.survey.cells import CellGrid, SightingPlace, count_cells
from locate.survey.coverage import FlightCoverage
from locate.survey.findings import Wind
from locate.survey.frame import PlumeSighting, offset_of, sightings_of
from locate.survey.model import Survey
from locate.survey.moments import bin_of, bin_order
from locate.survey.wind import wind_of


def fuse_flights(
    begun: Survey, coverages: Sequence[FlightCoverage | None]
) -> tuple[Survey, CellGrid | None]:
    """Hotspots, winds and cells of all flights together.

    Args:
        begun: Settings, origin and flights.
        coverages: Of each mapped flight; None where it is not known.
    """
    flights, frame, settings = begun.mapped, begun.frame, begun.settings
    offsets = [offset_of(flight, frame) for flight in flights]
    sightings = sightings_of(flights, offsets)
    winds = [
        wind_of(flight, [one for one in sightings if one.flight == i])
        for i, flight in enumerate(flights)
    ]
    leans = _centred_leans(winds)
    associated = associate(
        sightings,
        offsets,
        leans,
        wander_m=settings.wander_m,
        area_m2=_covered_area_m2(sightings, coverages, settings.cell_m),
    )
    labels = [bin_of(flight.moment, frame.lat_deg) for flight in flights]
    bins = tuple(sorted(set(labels), key=bin_order))
    cells = count_cells(
        coverages,
        labels,
        _sighting_places(sightings, associated, leans),
        bins=bins,
        cell_m=settings.cell_m,
        weakest_px=begun.column.displacement_px,
    )
    done = begun.model_copy(
        update={
            "version": __version__,
            "hotspots": hotspots_of(sightings, associated, coverages, labels, begun),
            "sightings": sightings_in(sightings, associated, leans, flights),
            "winds": tuple(wind for wind in winds if wind is not None),
            "drift_m": associated.solution.shared.drift_m,
            "drift_sigma_m": associated.solution.shared.drift_sigma_m,
            "prior": begun.prior if cells is None else cells.prior,
            "bins": bins,
            "notes": notes_of(begun),
        }
    )
    return done, cells


def _centred_leans(winds: Sequence[Wind | None]) -> FloatArray:
    """(F, 2) lean of each flight less the mean of all; zero where a flight has none."""
    known = [wind.lean for wind in winds if wind is not None]
    mean = np.mean(known, axis=0) if known else np.zeros(2)
    return np.array([np.zeros(2) if wind is None else wind.lean - mean for wind in winds])


def _covered_area_m2(
    sightings: Sequence[PlumeSighting], coverages: Sequence[FlightCoverage | None], cell_m: float
) -> float:
    """Of the ground that a flight covers (the median), or where something was seen."""
    places = np.reshape([one.position[:2] for one in sightings], (-1, 2))
    spanned = np.prod(np.ptp(places, axis=0) + 2 * cell_m) if len(places) else cell_m**2
    counts = [np.isfinite(one.limit_px).sum() for one in coverages if one is not None]
    return float(max(spanned, np.median(counts) * cell_m**2 if counts else 0.0))


def _sighting_places(
    sightings: Sequence[PlumeSighting], associated: AssociatedHotspots, leans: FloatArray
) -> list[SightingPlace]:
    positions, unsure = associated.solution.shared.correct_positions(sightings, leans)
    return [
        SightingPlace(
            flight=one.flight,
            position=positions[i, :2],
            covariance=(one.own_covariance + unsure[i])[:2, :2],
        )
        for i, one in enumerate(sightings)
    ]
