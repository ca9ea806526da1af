"""Errors of plumes, cameras and frames."""

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from geometry.errors import BadInputError
from geometry.plain import to_plain_values
from geometry.trajectory import Trajectory
from locate.evaluation.alignment import CameraAlignment, align_trajectories
from locate.evaluation.frames import FrameScore, frame_scores
from locate.evaluation.plumes import BearingError, PlumeError, bearing_errors, plume_errors
from locate.evaluation.truth import SceneTruth
from locate.map.plume import PlumeMap


@dataclass(frozen=True, kw_only=True)
class Evaluation:
    """A map against the truth.

    Attributes:
        alignment: How the cameras fit; None for a still camera.
        plumes: The plumes that were found.
        bearings: The directions that were found, from a still camera.
        misses: Numbers of the true plumes that nothing matched.
        false_plumes: Ids of plumes (or numbers of bearings) that match nothing true.
        frames: Scores frame by frame; empty without detections.
        units: Of the truth and every length here, ``"m"`` or ``"scene"``.
        notes: What limits this verdict.
    """

    alignment: CameraAlignment | None
    plumes: tuple[PlumeError, ...]
    bearings: tuple[BearingError, ...]
    misses: tuple[int, ...]
    false_plumes: tuple[int, ...]
    frames: tuple[FrameScore, ...]
    units: str
    notes: tuple[str, ...]

    def frame_median(self, name: str) -> float:
        """Median over the frames of a field of `FrameScore`; NaN where no frame has it."""
        values = np.array([getattr(frame, name) for frame in self.frames], dtype=float)
        finite = values[np.isfinite(values)]
        return float(np.median(finite)) if len(finite) else float("nan")

    def to_dict(self) -> dict[str, Any]:
        """Plain data for ``--json``; null where a number does not exist."""
        medians = ("auroc", "average_precision", "prior", "epe_px", "epe_of_zero_px")
        content = {
            **asdict(self),
            "frame_medians": {name: self.frame_median(name) for name in medians},
        }
        verdict: dict[str, Any] = to_plain_values(content, null_for_nan=True)
        return verdict


def evaluate_map(
    plume_map: PlumeMap,
    trajectory: Trajectory | None,
    truth_dir: Path,
    detections_dir: Path | None = None,
) -> Evaluation:
    """Compares a map with the truth of a simulated scene.

    Args:
        plume_map: The map of the run.
        trajectory: Its cameras; None where the camera stood still.
        truth_dir: Folder with truth.json and truth/.
        detections_dir: Folder of the run with 000000.npz and so on; None to skip the frames.

    Raises:
        BadInputError: The truth is unreadable, or shares too few frames with the run.
    """
    truth = SceneTruth.load(truth_dir)
    alignment = None if trajectory is None else align_trajectories(trajectory, truth.trajectory)
    if plume_map.plumes and alignment is None:
        raise BadInputError("the map has plumes but no cameras: its trajectory.json is missing")
    plumes = plume_errors(plume_map.plumes, truth, alignment.truth_from_map) if alignment else []
    bearings = bearing_errors(plume_map.bearings, truth)
    frames, notes = ([], []) if detections_dir is None else frame_scores(detections_dir, truth)
    found = {error.truth for error in plumes} | {error.truth for error in bearings}
    matched, pointed = {error.plume for error in plumes}, {error.bearing for error in bearings}
    false_plumes = [plume.id for plume in plume_map.plumes if plume.id not in matched]
    false_plumes += [i for i in range(len(plume_map.bearings)) if i not in pointed]
    return Evaluation(
        alignment=alignment,
        plumes=tuple(plumes),
        bearings=tuple(bearings),
        misses=tuple(i for i in range(len(truth.sources)) if i not in found),
        false_plumes=tuple(false_plumes),
        frames=tuple(frames),
        units=truth.trajectory.units,
        notes=tuple(notes),
    )
