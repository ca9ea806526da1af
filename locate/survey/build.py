"""The whole of a survey: flights in, one map out."""

import logging
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from geometry.errors import BadInputError
from geometry.lock import hold_lock
from geometry.named_paths import resolve_path
from geometry.reports import Report, ignore_report
from geometry.threads import with_one_thread
from locate.map.plume import Plume
from locate.pipeline.files import RunFiles
from locate.survey.coverage import CoverageJob, FlightCoverage
from locate.survey.engine import map_flights
from locate.survey.flights import FlightJob, RequestedFlight
from locate.survey.fuse import fuse_flights
from locate.survey.model import Flight, ReferenceColumn, Survey, SurveySettings
from locate.survey.publish import publish_survey
from locate.survey.raster import raster_notes

SURVEY, FLIGHTS, COVERAGES = "survey.json", "flights", "looks"
log = logging.getLogger("locate")


@with_one_thread
def build_survey(
    given: Sequence[Path],
    output: Path,
    *,
    settings: SurveySettings | None = None,
    scheduler: str | None = None,
    report: Report = ignore_report,
) -> Survey:
    """Adds flights to a survey, or begins one, and writes its map.

    A flight that was run before, from the same recording with the same settings, is not run again;
    flights of the survey that are not named stay in it. What the fusion of all flights gives does
    not depend on the order in which they came, but for the origin, the first flight's, and for the
    shape of the reference column, that of the first sightings.

    Args:
        given: Recordings (videos, folders of photos) and run folders; none to only map anew.
        output: The survey's folder.
        settings: None for those the survey had.
        scheduler: As of `map_flights`.
        report: Called with the progress.

    Raises:
        BadInputError: The folder cannot be used, another command is at work on it, or no flight
            could be placed on the Earth.
    """
    open_survey(output)
    with hold_lock(output):
        return _build_survey(given, output, settings, scheduler, report)


def _build_survey(
    given: Sequence[Path],
    output: Path,
    settings: SurveySettings | None,
    scheduler: str | None,
    report: Report,
) -> Survey:
    before = open_survey(output)
    settings = settings or before.settings
    flights = _run_flights(
        before, _name_flights(given, before, output), settings, scheduler, report
    )
    begun = Survey(settings=settings, origin=before.origin, flights=flights)
    begun = begun.model_copy(update={"origin": begun.origin or _survey_origin(begun.mapped)})
    if not flights:
        raise BadInputError(f"{output}: holds no survey yet; name its first flights")
    begun = begun.model_copy(update={"column": _reference_column(begun, before)})
    begun.save(output / SURVEY)
    if not begun.mapped:
        reasons = "; ".join(f"{one.name}: {one.failure}" for one in flights)
        raise BadInputError(f"{output}: no flight could be placed on the Earth ({reasons})")
    coverages, notes = _measure_coverages(begun, output, scheduler, report)
    column = {"displacement_px": displacement_px(settings, coverages)}
    begun = begun.model_copy(update={"column": begun.column.model_copy(update=column)})
    done, cells = fuse_flights(begun, coverages)
    done = done.model_copy(update={"notes": (*done.notes, *notes, *raster_notes())})
    publish_survey(output, done, cells)
    done.save(output / SURVEY)
    report("map", 1.0)
    return done


def open_survey(output: Path) -> Survey:
    """The survey that a folder holds, or an empty one; the folder is made where it is missing.

    Raises:
        BadInputError: It cannot be written, or holds a survey of another version.
    """
    try:
        output.mkdir(parents=True, exist_ok=True)
        for name in (FLIGHTS, COVERAGES):
            (output / name).mkdir(exist_ok=True)
    except OSError as error:
        raise BadInputError(
            f"{output}: cannot be written ({error.strerror}); choose another folder with -o"
        ) from error
    path = output / SURVEY
    return Survey.load(path) if path.exists() else Survey()


def _name_flights(given: Sequence[Path], before: Survey, output: Path) -> list[RequestedFlight]:
    """Each flight under a name of its own; those that the survey knows keep theirs."""
    known = {flight.source: flight for flight in before.flights}
    taken = {flight.name for flight in before.flights}
    found: list[RequestedFlight] = []
    for path in dict.fromkeys(resolve_path(path) for path in given):
        if not path.exists():
            raise BadInputError(f"{path}: no such recording or run folder")
        flight = known.get(path)
        name = _free_name(path, taken) if flight is None else flight.name
        taken.add(name)
        folder = path if RunFiles(path).config.is_file() else resolve_path(output) / FLIGHTS / name
        found.append(RequestedFlight(name=name, source=path, folder=folder, known=flight))
    return found


def _free_name(path: Path, taken: set[str]) -> str:
    stem = path.name if path.is_dir() else path.stem
    numbered = (stem if k == 1 else f"{stem}-{k}" for k in range(1, len(taken) + 2))
    return next(name for name in numbered if name not in taken)


def _run_flights(
    before: Survey,
    given: Sequence[RequestedFlight],
    settings: SurveySettings,
    scheduler: str | None,
    report: Report,
) -> tuple[Flight, ...]:
    flights = {flight.name: flight for flight in before.flights}
    flights |= {one.name: flights.get(one.name) or _waiting_flight(one) for one in given}
    report("flights", 0.0)
    for done, (one, flight) in enumerate(
        map_flights(FlightJob(settings=settings), given, scheduler), 1
    ):
        flights[one.name] = flight
        log.info(flight.failure or "placed", extra={"stage": one.name})
        report("flights", done / len(given))
    return tuple(flights.values())


def _waiting_flight(one: RequestedFlight) -> Flight:
    return Flight(
        name=one.name, source=one.source, folder=one.folder, digest="", failure="not run yet"
    )


def _survey_origin(mapped: Sequence[Flight]) -> dict[str, object] | None:
    if not mapped:
        return None
    place = mapped[0].georeference
    return replace(place, name=f"{place.name} of {mapped[0].name}").to_dict()


def _reference_column(begun: Survey, before: Survey) -> ReferenceColumn:
    """The shape of the reference column: as stated, or the median of what was seen.

    It stays as it was, so that another flight does not change the coverage of the others.
    """
    column = before.column
    if not _all_plumes(before) and (plumes := _all_plumes(begun)):
        radii = [np.median(plume.radius_by_height[:, 1]) for plume in plumes]
        column = ReferenceColumn(
            radius_m=float(np.median(radii)),
            height_m=float(np.median([plume.extent_high for plume in plumes])),
        )
    stated = begun.settings.model_dump(include={"radius_m", "height_m"}, exclude_none=True)
    return column.model_copy(update=stated)


def displacement_px(settings: SurveySettings, coverages: Sequence[FlightCoverage | None]) -> float:
    """Displacement of the reference column: as stated, or the median of what was seen."""
    if settings.displacement_px is not None:
        return settings.displacement_px
    seen_px = np.concatenate([np.zeros(0), *(one.seen_px for one in coverages if one is not None)])
    known = seen_px[np.isfinite(seen_px)]
    return float(np.median(known)) if len(known) else ReferenceColumn().displacement_px


def _all_plumes(survey: Survey) -> list[Plume]:
    return [plume for flight in survey.mapped for plume in flight.plume_map.plumes]


def _measure_coverages(
    begun: Survey, output: Path, scheduler: str | None, report: Report
) -> tuple[list[FlightCoverage | None], tuple[str, ...]]:
    job = CoverageJob(
        folder=resolve_path(output) / COVERAGES,
        frame=begun.frame,
        cell_m=begun.settings.cell_m,
        column=begun.column,
    )
    missing: dict[str, str] = {}
    for done, (flight, why) in enumerate(map_flights(job, begun.mapped, scheduler), 1):
        if why is not None:
            missing[flight.name] = why
        report("coverage", done / len(begun.mapped))
    coverages = [
        None if flight.name in missing else FlightCoverage.load(job.folder / f"{flight.name}.npz")
        for flight in begun.mapped
    ]
    notes = (f"The coverage of {name} is not known: {why}." for name, why in missing.items())
    return coverages, tuple(notes)
