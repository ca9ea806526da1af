"""What a survey keeps: survey.json, schema ``locate.survey/1``."""

import json
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Annotated, Any, Literal, Self

from pydantic import AfterValidator, Field, FiniteFloat

from geometry.atomic import write_text_atomic
from geometry.errors import BadInputError
from geometry.georeference import Georeference
from geometry.json_values import check_fields
from geometry.removal import is_plain_name
from geometry.text_files import read_json
from locate import __version__
from locate.map.plume import PlumeMap
from locate.pipeline.config import DetectorName, RunConfig
from locate.survey.findings import Hotspot, SightingRecord, SurveyBlock, Wind

SCHEMA = "locate.survey/1"


def _checked_flight_name(name: str) -> str:
    if not is_plain_name(name):
        raise ValueError("a flight's name is that of one file: no / in it")
    return name


class SurveySettings(SurveyBlock):
    """The settings of a survey; the first five go to every run.

    Attributes:
        detector: As of `RunConfig`.
        weights: Likewise.
        camera: Likewise.
        focal_px: Likewise.
        max_frames: Likewise.
        cell_m: Edge of a cell of the ground.
        displacement_px: A flight has covered a cell where it would have detected a column that
            displaces the background uniformly by this much; None for the median sighting, as
            the uniform displacement that would have given as much evidence.
        radius_m: Of that column; None for the median of the first sightings the survey had.
        height_m: Likewise.
        wander_m: Standard deviation, each way, of where one hotspot sends up its column from one
            flight to the next.
    """

    detector: DetectorName = "auto"
    weights: Path | None = None
    camera: Path | None = None
    focal_px: float | None = Field(default=None, gt=0)
    max_frames: int = Field(default=120, ge=2)
    cell_m: float = Field(default=5.0, gt=0)
    displacement_px: float | None = Field(default=None, gt=0)
    radius_m: float | None = Field(default=None, gt=0)
    height_m: float | None = Field(default=None, gt=0)
    wander_m: float = Field(default=1.0, ge=0)

    def run_of(self, recording: Path) -> RunConfig:
        """The settings of one flight's run."""
        shared = self.model_dump(include=set(RunConfig.model_fields))
        return RunConfig(recording=recording, **shared)


class FlightMoment(SurveyBlock):
    """When a flight was.

    Attributes:
        clock_s: Seconds since 1970 of its middle, on the clock named by `basis`.
        hour: Of the day, 0 to 24: mean solar time where the clock is UTC, else as recorded.
        day_of_year: From 1.
        basis: ``"UTC"``, or ``"recorder"`` where only the recorder's own clock is known, which
            may be an hour or two from solar time.
    """

    clock_s: FiniteFloat
    hour: float = Field(ge=0, lt=24)
    day_of_year: int = Field(ge=1, le=366)
    basis: Literal["UTC", "recorder"]

    @property
    def local(self) -> datetime:
        """The date, with `hour` as its time of day."""
        stated = datetime.fromtimestamp(self.clock_s, UTC).replace(tzinfo=None)
        midnight = stated.replace(hour=0, minute=0, second=0, microsecond=0)
        near = (midnight + timedelta(days=days, hours=self.hour) for days in (-1, 0, 1))
        return min(near, key=lambda moment: abs(moment - stated))


class Flight(SurveyBlock):
    """One flight of a survey.

    Attributes:
        name: Unique within the survey.
        source: The recording or run folder.
        folder: Its run folder.
        digest: Of its inputs; another one means that it must be run again.
        failure: Why it has no place on the map; None where it has.
        map: The content of its map.json.
        moment: When it was; None where that is not known.
        path_lon_lat: Some of the places the camera was at, WGS84.
    """

    name: Annotated[str, AfterValidator(_checked_flight_name)]
    source: Path
    folder: Path
    digest: str
    failure: str | None = None
    map: dict[str, Any] | None = None
    moment: FlightMoment | None = None
    path_lon_lat: tuple[tuple[FiniteFloat, FiniteFloat], ...] = ()

    @property
    def plume_map(self) -> PlumeMap:
        """Its map.

        Raises:
            BadInputError: It failed, or its map is not one of this version.
        """
        return PlumeMap.from_dict(self.map)

    @property
    def georeference(self) -> Georeference:
        """Where the frame of its map sits."""
        return Georeference.from_dict(self.plume_map.georeference or {})


class ReferenceColumn(SurveyBlock):
    """The weakest column that a flight must have been able to detect where it covered.

    Attributes:
        radius_m: Of the column.
        height_m: Of the column, from the ground.
        displacement_px: Uniform displacement that it causes.
    """

    radius_m: float = Field(default=1.0, gt=0)
    height_m: float = Field(default=10.0, gt=0)
    displacement_px: float = Field(default=1.0, gt=0)


class Survey(SurveyBlock):
    """Many flights, one map.

    Attributes:
        version: Of this program.
        settings: As used.
        origin: Of the survey's east-north-up frame: the keys of a georeference block.
        column: The reference column; the default before anything was seen.
        flights: In the order they came.
        hotspots: What rises where.
        sightings: Of them.
        winds: By flight.
        drift_m: Metres the foot of a column moves downwind per unit of lean, all hotspots.
        drift_sigma_m: Standard deviation of that.
        prior: Mean and weight (in flights) of the Beta prior of a cell's probability.
        bins: Labels of season and hours that hold flights, in the order of the raster's bands.
        notes: What a reader must know.
    """

    version: str = __version__
    settings: SurveySettings = SurveySettings()
    origin: dict[str, Any] | None = None
    column: ReferenceColumn = ReferenceColumn()
    flights: tuple[Flight, ...] = ()
    hotspots: tuple[Hotspot, ...] = ()
    sightings: tuple[SightingRecord, ...] = ()
    winds: tuple[Wind, ...] = ()
    drift_m: FiniteFloat = 0.0
    drift_sigma_m: FiniteFloat = 0.0
    prior: tuple[FiniteFloat, FiniteFloat] = (0.5, 1.0)
    bins: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()

    @property
    def frame(self) -> Georeference:
        """The survey's frame.

        Raises:
            BadInputError: No flight has a place on the Earth.
        """
        if self.origin is None:
            raise BadInputError("the survey has no flight with a place on the Earth")
        return Georeference.from_dict(self.origin)

    @property
    def mapped(self) -> tuple[Flight, ...]:
        """The flights that have a place on the map."""
        return tuple(flight for flight in self.flights if flight.failure is None)

    def save(self, path: Path) -> None:
        """Writes survey.json, whole or not at all."""
        content = {"schema": SCHEMA, **self.model_dump(mode="json")}
        write_text_atomic(path, json.dumps(content, indent=1, allow_nan=False))

    @classmethod
    def load(cls, path: Path) -> Self:
        """Reads survey.json.

        Raises:
            BadInputError: The file is missing, not JSON, or not a survey of this version.
        """
        content = read_json(path)
        schema = content.pop("schema", None) if isinstance(content, dict) else None
        if schema != SCHEMA:
            raise BadInputError(
                f"{path}: schema is {schema!r}, expected {SCHEMA!r}; choose another folder with -o"
            )
        try:
            return check_fields(cls, content)
        except ValueError as error:
            raise BadInputError(f"{path}: {error}") from error
