"""One flight: run where it has to be, then read from its run folder."""

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from geometry.errors import BadInputError, InterruptedRunError, LocateError
from geometry.georeference import Georeference
from geometry.named_paths import is_there
from geometry.trajectory import Trajectory
from locate.journal.log import log_to_file
from locate.map.plume import PlumeMap
from locate.pipeline.config import RunConfig, read_settings
from locate.pipeline.files import RunFiles
from locate.pipeline.fingerprint import digest, fingerprint_path
from locate.pipeline.source import telemetry_of
from locate.survey.model import Flight, SurveySettings
from locate.survey.moments import moment_of

PATH_POINTS = 64
"""Places of the camera kept of each flight, for the drawing."""
BATCHES = 2
"""Tasks that the detections of one flight are divided into; chosen."""
NOT_LOCATED = "its place on the Earth is not known; give telemetry"
AT_REST = "the camera stood still: it gives directions, not positions"


@dataclass(frozen=True, kw_only=True)
class RequestedFlight:
    """A flight as it was named on the command line.

    Attributes:
        name: Unique within the survey.
        source: A recording, or a run folder.
        folder: The run folder; the source itself where that is one.
        known: What the survey already holds of it; None for a new one.
    """

    name: str
    source: Path
    folder: Path
    known: Flight | None = None


@dataclass(frozen=True, kw_only=True)
class FlightJob:
    """The job done for each flight: a run, if it is needed, and what the survey keeps of it."""

    settings: SurveySettings

    def __call__(self, requested: RequestedFlight) -> Flight:
        """Returns the flight; a failure that its files cause is part of it, not raised."""
        made_from = ""
        try:
            made_from = self._input_digest(requested)
            if requested.known is not None and self._is_current(requested):
                return requested.known
            if requested.folder != requested.source:
                self._run_pipeline(requested)
            return read_flight(requested, made_from)
        except InterruptedRunError:
            raise
        except LocateError as error:
            return self.failed_result(requested, str(error), made_from)

    def list_parts(self, requested: RequestedFlight) -> tuple[tuple[str, ...], ...]:
        """The stages of a run that are worth a task of their own; detections come in batches."""
        try:
            if requested.folder == requested.source or self._is_current(requested):
                return ()
        except LocateError:  # raised again, and reported, when the job itself is called
            return ()
        return ("frames",), ("poses",), tuple(f"detections {k}" for k in range(BATCHES))

    def do_part(self, requested: RequestedFlight, name: str) -> str | None:
        """Does one part; returns the failure that the flight's files cause, or None."""
        from locate.pipeline.run import Run

        share = (int(name.split()[1]), BATCHES) if name.startswith("detections") else None
        try:
            run = Run(self.settings.run_of(requested.source), requested.folder)
            with log_to_file(RunFiles(requested.folder).log):
                run.prepare(poses=name != "frames", share=share)
        except InterruptedRunError:
            raise
        except LocateError as error:
            return str(error)
        return None

    def failed_result(self, requested: RequestedFlight, why: str, made_from: str = "") -> Flight:
        """What the survey keeps of a flight that cannot be used."""
        return Flight(
            name=requested.name,
            source=requested.source,
            folder=requested.folder,
            digest=made_from,
            failure=why,
        )

    def _is_current(self, requested: RequestedFlight) -> bool:
        known = requested.known
        return (
            known is not None
            and known.failure is None
            and known.digest == self._input_digest(requested)
        )

    def _input_digest(self, requested: RequestedFlight) -> str:
        if requested.folder == requested.source:
            return fingerprint_path(RunFiles(requested.folder).map)
        settings = self.settings.run_of(requested.source).to_plain()
        content = {"recording": fingerprint_path(requested.source), **settings}
        return digest(json.dumps(content, sort_keys=True).encode())

    def _run_pipeline(self, requested: RequestedFlight) -> None:
        from locate.pipeline.run import Run

        run = Run(self.settings.run_of(requested.source), requested.folder)
        with log_to_file(RunFiles(requested.folder).log):
            run.run()


def read_flight(requested: RequestedFlight, made_from: str) -> Flight:
    """What a survey keeps of a finished run.

    Raises:
        BadInputError: The folder does not hold a run, or the run has no place on the Earth.
    """
    plume_map = PlumeMap.load(RunFiles(requested.folder).map)
    if not RunFiles(requested.folder).trajectory.exists():
        raise BadInputError(f"{requested.source}: {AT_REST}")
    if plume_map.georeference is None or "covariance" not in plume_map.georeference:
        raise BadInputError(f"{requested.source}: {NOT_LOCATED}")
    trajectory = Trajectory.load(RunFiles(requested.folder).trajectory)
    place = Georeference.from_dict(plume_map.georeference)
    rows = np.unique(np.linspace(0, len(trajectory) - 1, PATH_POINTS).astype(int))
    lat, lon, _ = place.lat_lon_height(trajectory.centers_in_world[rows]).T
    config = read_config(requested.folder)
    telemetry = () if config is None else telemetry_of(config.recording, config.telemetry)
    return Flight(
        name=requested.name,
        source=requested.source,
        folder=requested.folder,
        digest=made_from,
        map=plume_map.to_dict(),
        moment=moment_of(telemetry),
        path_lon_lat=tuple(zip(lon.tolist(), lat.tolist(), strict=True)),
    )


def read_config(folder: Path) -> RunConfig | None:
    """The configuration of a run; None where its recording is gone."""
    path = RunFiles(folder).config
    config = RunConfig.of(read_settings(path), where=f"{path}: ")
    return config if is_there(config.recording) else None
