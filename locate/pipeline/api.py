"""A run as one call."""

from pathlib import Path
from typing import Any

from geometry.reports import Report, ignore_report
from locate.journal.log import log_to_file
from locate.map.plume import PlumeMap
from locate.pipeline.config import RunConfig
from locate.pipeline.files import RunFiles
from locate.pipeline.run import Run


def run(
    recording: str | Path | RunConfig,
    output: str | Path,
    *,
    force: bool = False,
    report: Report = ignore_report,
    jobs: int = 1,
    **settings: Any,
) -> PlumeMap:
    """Turns a recording into a map; what an earlier call of the same has done is not done again.

    Args:
        recording: A video, a folder of photos or a bag; or all settings at once.
        output: The run folder, made where it is missing.
        force: Do every stage again.
        report: Called with the name of a stage and the share of it that is done, from 0 to 1.
        jobs: Processes and threads that work side by side; the results do not depend on it.
        settings: Attributes of `RunConfig`; they go before those of `recording`.

    Returns:
        The map, as it is in ``output/map.json``.

    Raises:
        BadInputError: Something given cannot be used.
        RegistrationError: The frames could not be registered; the error names the cause.

    Examples:
        >>> import locate
        >>> plume_map = locate.run("video.mkv", "out", max_frames=14)
        >>> plume_map.units
        'scene'
    """
    given = dict(recording) if isinstance(recording, RunConfig) else {"recording": recording}
    config = RunConfig.of({**given, **settings})
    job = Run(config, Path(output), force=force, report=report, jobs=jobs)
    with log_to_file(RunFiles(Path(output)).log):
        return job.run()


def load_map(path: str | Path) -> PlumeMap:
    """Reads the map of a run.

    Args:
        path: A map.json, or the run folder that holds one.

    Raises:
        BadInputError: The file is missing, not JSON, or not a map of this version.

    Examples:
        >>> import locate
        >>> plume_map = locate.load_map("out")
        >>> [plume.id for plume in plume_map.plumes] == list(range(1, len(plume_map.plumes) + 1))
        True
    """
    path = Path(path)
    return PlumeMap.load(RunFiles(path).map if path.is_dir() else path)
