"""The evaluation of a run as one call."""

from pathlib import Path

from geometry.trajectory import Trajectory
from locate.evaluation.evaluation import Evaluation, evaluate_map
from locate.map.plume import PlumeMap
from locate.pipeline.files import RunFiles


def evaluate(output: str | Path, truth: str | Path) -> Evaluation:
    """Compares the map of a run with the truth of the simulated scene it recorded.

    Args:
        output: The run folder.
        truth: The folder that ``locate simulate`` wrote.

    Raises:
        BadInputError: The map or the truth cannot be read, or they share too few frames.

    Examples:
        >>> import locate
        >>> evaluation = locate.evaluate("out", "scene")
        >>> evaluation.units
        'm'
        >>> len(evaluation.plumes) + len(evaluation.misses)
        1
    """
    files = RunFiles(Path(output))
    return evaluate_map(
        PlumeMap.load(files.map),
        Trajectory.load(files.trajectory) if files.trajectory.exists() else None,
        Path(truth),
        files.detections,
    )
