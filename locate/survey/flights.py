"""One flight: run where it has to be, then read from its run folder."""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from geometry.errors import BadInputError, InterruptedRunError, LocateError
from geometry.georeference import Georeference
from geometry.trajectory import Trajectory
from locate.journal.log import log_to_file
from locate.map.plume import PlumeMap
from locate.pipeline.config import RunConfig
from locate.pipeline.files import RunFiles
from locate.pipeline.fingerprint import digest, fingerprint_path
from locate.pipeline.source import telemetry_of
from locate.survey.model import Flight, Settings
from locate.survey.moments import moment_of

PATH_POINTS = 64
BATCHES = 2
NOT_LOCATED = "nothing says where on the Earth it was; give telemetry"
AT_REST = "the camera stood still: it gives directions, not positions"


@dataclass(frozen=True, kw_only=True)
class Given:
    """A flight as it was named on the command line.

    Attributes:
        name: Unique within the survey.
        source: A recording, or a run folder.
        folder: The run folder; the source itself where that is one.
        known: What the survey holds of it from before.
    """

    name: str
    source: Path
    folder: Path
    known: Flight | None = None


@dataclass(frozen=True, kw_only=True)
class Fly:
    """The job done for each flight: a run, if it is needed, and what the survey keeps of it."""

    settings: Settings

    def __call__(self, given: Given) -> Flight:
        """Never raises what a flight can be to blame for: the failure is part of the answer."""
        made_from = ""
        try:
            made_from = self._digest(given)
            if given.known is not None and self._stands(given):
                return given.known
            if given.folder != given.source:
                self._run(given)
            return read_flight(given, made_from)
        except InterruptedRunError:
            raise
        except LocateError as error:
            return self.failed(given, str(error), made_from)

    def parts(self, given: Given) -> tuple[tuple[str, ...], ...]:
        """The stages of a run that are worth a task of their own; frames are seen in batches."""
        try:
            if given.folder == given.source or self._stands(given):
                return ()
        except LocateError:  # met again, and told of, when the job itself is called
            return ()
        return ("frames",), ("poses",), tuple(f"detections {k}" for k in range(BATCHES))

    def part(self, given: Given, name: str) -> str | None:
        """Does one part; returns what the flight is to blame for."""
        from locate.pipeline.run import Run

        share = (int(name.split()[1]), BATCHES) if name.startswith("detections") else None
        try:
            run = Run(self.settings.run_of(given.source), given.folder)
            with log_to_file(RunFiles(given.folder).log):
                run.prepare(poses=name != "frames", share=share)
        except InterruptedRunError:
            raise
        except LocateError as error:
            return str(error)
        return None

    def failed(self, given: Given, why: str, made_from: str = "") -> Flight:
        """What the survey keeps of a flight that cannot be used."""
        return Flight(
            name=given.name,
            source=given.source,
            folder=given.folder,
            digest=made_from,
            failure=why,
        )

    def _stands(self, given: Given) -> bool:
        known = given.known
        return known is not None and known.failure is None and known.digest == self._digest(given)

    def _digest(self, given: Given) -> str:
        if given.folder == given.source:
            return fingerprint_path(RunFiles(given.folder).map)
        settings = self.settings.run_of(given.source).to_plain()
        content = {"recording": fingerprint_path(given.source), **settings}
        return digest(json.dumps(content, sort_keys=True).encode())

    def _run(self, given: Given) -> None:
        from locate.pipeline.run import Run

        run = Run(self.settings.run_of(given.source), given.folder)
        with log_to_file(RunFiles(given.folder).log):
            run.run()


def read_flight(given: Given, made_from: str) -> Flight:
    """What a survey keeps of a finished run.

    Raises:
        BadInputError: The folder does not hold a run, or the run has no place on the Earth.
    """
    answer = PlumeMap.load(RunFiles(given.folder).map)
    if not RunFiles(given.folder).trajectory.exists():
        raise BadInputError(f"{given.source}: {AT_REST}")
    if answer.georeference is None or "covariance" not in answer.georeference:
        raise BadInputError(f"{given.source}: {NOT_LOCATED}")
    trajectory = Trajectory.load(RunFiles(given.folder).trajectory)
    place = Georeference.from_dict(answer.georeference)
    rows = np.unique(np.linspace(0, len(trajectory) - 1, PATH_POINTS).astype(int))
    lat, lon, _ = place.lat_lon_height(trajectory.centers_in_world[rows]).T
    config = read_config(given.folder)
    telemetry = () if config is None else telemetry_of(config.recording, config.telemetry)
    return Flight(
        name=given.name,
        source=given.source,
        folder=given.folder,
        digest=made_from,
        map=answer.to_dict(),
        moment=moment_of(telemetry),
        path_lon_lat=tuple(zip(lon.tolist(), lat.tolist(), strict=True)),
    )


def read_config(folder: Path) -> RunConfig | None:
    """What a run was told; None where its recording is gone."""
    path = RunFiles(folder).config
    try:
        content: dict[str, Any] = yaml.safe_load(path.read_text())
        known = {name: content[name] for name in RunConfig.model_fields if name in content}
        config = RunConfig(**known)
    except (OSError, ValueError, TypeError, yaml.YAMLError) as error:
        raise BadInputError(f"{path}: not a readable run configuration ({error})") from error
    return config if config.recording.exists() else None
