"""The whole of a survey: flights in, one map out."""

import logging
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from geometry.arrays import FloatArray
from geometry.errors import BadInputError
from geometry.threads import with_one_blas_thread
from locate import __version__
from locate.journal.progress import Report, silent
from locate.map.plume import Plume
from locate.pipeline.files import RunFiles
from locate.survey.answer import hotspots_of, notes_of, sightings_in
from locate.survey.associate import Fused, associate
from locate.survey.cells import Cells, Spot, count_cells
from locate.survey.coverage import Look, Looks
from locate.survey.engine import map_flights
from locate.survey.findings import Wind
from locate.survey.flights import Fly, Given
from locate.survey.frame import Seen, offset_of, sightings_of
from locate.survey.model import Column, Flight, Settings, Survey
from locate.survey.moments import bin_of, bin_order
from locate.survey.publish import publish
from locate.survey.wind import wind_of

SURVEY, FLIGHTS, LOOKS = "survey.json", "flights", "looks"
log = logging.getLogger("locate")


@with_one_blas_thread
def survey(
    given: Sequence[Path],
    output: Path,
    *,
    settings: Settings | None = None,
    scheduler: str | None = None,
    report: Report = silent,
) -> Survey:
    """Adds flights to a survey, or begins one, and writes its map.

    A flight that was run before, from the same recording with the same settings, is not run again;
    flights of the survey that are not named stay in it. What the fusion of all flights gives does
    not depend on the order in which they came, but for the origin, the first flight's, and for the
    shape of the column that a look must find, that of the first sightings.

    Args:
        given: Recordings (videos, folders of photos) and run folders; none to only map anew.
        output: The survey's folder.
        settings: None for those the survey had.
        scheduler: As of `map_flights`.
        report: Told how far it is.

    Raises:
        BadInputError: The folder cannot be used, or no flight could be placed on the Earth.
    """
    before = opened(output)
    settings = settings or before.settings
    flights = _flown(before, _named(given, before, output), settings, scheduler, report)
    begun = Survey(settings=settings, origin=before.origin, flights=flights)
    begun = begun.model_copy(update={"origin": begun.origin or _origin(begun.mapped)})
    if not flights:
        raise BadInputError(f"{output}: holds no survey yet; name its first flights")
    begun = begun.model_copy(update={"column": column_of(begun, before)})
    begun.save(output / SURVEY)
    if not begun.mapped:
        reasons = "; ".join(f"{one.name}: {one.failure}" for one in flights)
        raise BadInputError(f"{output}: no flight could be placed on the Earth ({reasons})")
    looks, notes = _looked(begun, output, scheduler, report)
    column = {"displacement_px": displacement_px(settings, looks)}
    begun = begun.model_copy(update={"column": begun.column.model_copy(update=column)})
    done, cells = fuse(begun, looks)
    done = done.model_copy(update={"notes": (*done.notes, *notes)})
    publish(output, done, cells)
    done.save(output / SURVEY)
    report("map", 1.0)
    return done


def opened(output: Path) -> Survey:
    """The survey that a folder holds, or an empty one; the folder is made where it is missing.

    Raises:
        BadInputError: It cannot be written, or holds a survey of another version.
    """
    try:
        output.mkdir(parents=True, exist_ok=True)
        for name in (FLIGHTS, LOOKS):
            (output / name).mkdir(exist_ok=True)
    except OSError as error:
        raise BadInputError(
            f"{output}: cannot be written ({error.strerror}); choose another folder with -o"
        ) from error
    path = output / SURVEY
    return Survey.load(path) if path.exists() else Survey()


def _named(given: Sequence[Path], before: Survey, output: Path) -> list[Given]:
    """Each flight under a name of its own; those that the survey knows keep theirs."""
    known = {flight.source: flight for flight in before.flights}
    taken = {flight.name for flight in before.flights}
    found: list[Given] = []
    for path in dict.fromkeys(path.resolve() for path in given):
        if not path.exists():
            raise BadInputError(f"{path}: no such recording or run folder")
        flight = known.get(path)
        name = _free_name(path, taken) if flight is None else flight.name
        taken.add(name)
        folder = path if RunFiles(path).config.is_file() else output.resolve() / FLIGHTS / name
        found.append(Given(name=name, source=path, folder=folder, known=flight))
    return found


def _free_name(path: Path, taken: set[str]) -> str:
    stem = path.name if path.is_dir() else path.stem
    numbered = (stem if k == 1 else f"{stem}-{k}" for k in range(1, len(taken) + 2))
    return next(name for name in numbered if name not in taken)


def _flown(
    before: Survey,
    given: Sequence[Given],
    settings: Settings,
    scheduler: str | None,
    report: Report,
) -> tuple[Flight, ...]:
    flights = {flight.name: flight for flight in before.flights}
    flights |= {one.name: flights.get(one.name) or _waiting(one) for one in given}
    report("flights", 0.0)
    for done, (one, flight) in enumerate(map_flights(Fly(settings=settings), given, scheduler), 1):
        flights[one.name] = flight
        log.info(flight.failure or "placed", extra={"stage": one.name})
        report("flights", done / len(given))
    return tuple(flights.values())


def _waiting(one: Given) -> Flight:
    return Flight(
        name=one.name, source=one.source, folder=one.folder, digest="", failure="not run yet"
    )


def _origin(mapped: Sequence[Flight]) -> dict[str, object] | None:
    if not mapped:
        return None
    place = mapped[0].georeference
    return replace(place, name=f"{place.name} of {mapped[0].name}").to_dict()


def column_of(begun: Survey, before: Survey) -> Column:
    """The shape of what a look must be able to find: as told, or like what was seen.

    It stays as it was, so that another flight changes nothing of what is known of the others.
    """
    column = before.column
    if not _plumes(before) and (plumes := _plumes(begun)):
        radii = [np.median(plume.radius_by_height[:, 1]) for plume in plumes]
        column = Column(
            radius_m=float(np.median(radii)),
            height_m=float(np.median([plume.extent_high for plume in plumes])),
        )
    told = begun.settings.model_dump(include={"radius_m", "height_m"}, exclude_none=True)
    return column.model_copy(update=told)


def displacement_px(settings: Settings, looks: Sequence[Looks | None]) -> float:
    """What a look must be able to find: as told, or the median of what was seen."""
    if settings.displacement_px is not None:
        return settings.displacement_px
    seen_px = np.concatenate([np.zeros(0), *(one.seen_px for one in looks if one is not None)])
    known = seen_px[np.isfinite(seen_px)]
    return float(np.median(known)) if len(known) else Column().displacement_px


def _plumes(survey: Survey) -> list[Plume]:
    return [plume for flight in survey.mapped for plume in flight.answer.plumes]


def _looked(
    begun: Survey, output: Path, scheduler: str | None, report: Report
) -> tuple[list[Looks | None], tuple[str, ...]]:
    job = Look(
        folder=output.resolve() / LOOKS,
        frame=begun.frame,
        cell_m=begun.settings.cell_m,
        column=begun.column,
    )
    missing: dict[str, str] = {}
    for done, (flight, why) in enumerate(map_flights(job, begun.mapped, scheduler), 1):
        if why is not None:
            missing[flight.name] = why
        report("looks", done / len(begun.mapped))
    looks = [
        None if flight.name in missing else Looks.load(job.folder / f"{flight.name}.npz")
        for flight in begun.mapped
    ]
    notes = (f"Where {name} looked is not known: {why}." for name, why in missing.items())
    return looks, tuple(notes)


def fuse(begun: Survey, looks: Sequence[Looks | None]) -> tuple[Survey, Cells | None]:
    """Hotspots, winds and cells of all flights together.

    Args:
        begun: Settings, origin and flights.
        looks: Of each mapped flight; None where they are not known.
    """
    flights, frame, settings = begun.mapped, begun.frame, begun.settings
    offsets = [offset_of(flight, frame) for flight in flights]
    seen = sightings_of(flights, offsets)
    winds = [
        wind_of(flight, [one for one in seen if one.flight == i])
        for i, flight in enumerate(flights)
    ]
    leans = centred_leans(winds)
    fused = associate(
        seen,
        offsets,
        leans,
        wander_m=settings.wander_m,
        area_m2=area_m2(seen, looks, settings.cell_m),
    )
    labels = [bin_of(flight.moment, frame.lat_deg) for flight in flights]
    bins = tuple(sorted(set(labels), key=bin_order))
    cells = count_cells(
        looks,
        labels,
        _spots(seen, fused, leans),
        bins=bins,
        cell_m=settings.cell_m,
        weakest_px=begun.column.displacement_px,
    )
    done = begun.model_copy(
        update={
            "version": __version__,
            "hotspots": hotspots_of(seen, fused, looks, labels, begun),
            "sightings": sightings_in(seen, fused, leans, flights),
            "winds": tuple(wind for wind in winds if wind is not None),
            "drift_m": fused.solved.common.drift_m,
            "drift_sigma_m": fused.solved.common.drift_sigma_m,
            "prior": begun.prior if cells is None else cells.prior,
            "bins": bins,
            "notes": notes_of(begun),
        }
    )
    return done, cells


def centred_leans(winds: Sequence[Wind | None]) -> FloatArray:
    """(F, 2) lean of each flight less the mean of all; zero where a flight shows none."""
    known = [wind.lean for wind in winds if wind is not None]
    mean = np.mean(known, axis=0) if known else np.zeros(2)
    return np.array([np.zeros(2) if wind is None else wind.lean - mean for wind in winds])


def area_m2(seen: Sequence[Seen], looks: Sequence[Looks | None], cell_m: float) -> float:
    """Of the ground that a flight looks at (the median), or where something was seen."""
    places = np.reshape([one.position[:2] for one in seen], (-1, 2))
    spanned = np.prod(np.ptp(places, axis=0) + 2 * cell_m) if len(places) else cell_m**2
    counts = [np.isfinite(one.limit_px).sum() for one in looks if one is not None]
    return float(max(spanned, np.median(counts) * cell_m**2 if counts else 0.0))


def _spots(seen: Sequence[Seen], fused: Fused, leans: FloatArray) -> list[Spot]:
    positions, unsure = fused.solved.common.corrected(seen, leans)
    return [
        Spot(
            flight=one.flight,
            position=positions[i, :2],
            covariance=(one.own + unsure[i])[:2, :2],
        )
        for i, one in enumerate(seen)
    ]
