"""What came out of a run on a case, in one file."""

import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, Self

import numpy as np

from benchmarks.real_frames.cases import Case
from benchmarks.real_frames.displacement import (
    THIRDS,
    FrameRatios,
    frame_ratios,
    informed_over_true,
    signal_over_noise,
    true_in_undistorted,
)
from detect.detection import Detection
from geometry.plain import to_plain_values
from geometry.trajectory import Trajectory
from locate.evaluation import evaluate_map
from locate.evaluation.truth import SceneTruth
from locate.map.plume import PlumeMap
from locate.pipeline.detections import load_detections
from locate.pipeline.files import RunFiles
from locate.recording.images import FrameImages

Thirds = list[float | None]
"""Of the lowest, middle and highest third."""


@dataclass(frozen=True, kw_only=True)
class CaseScore:
    """The answer of a run against the truth; None for what does not exist.

    Attributes:
        recording: Its name.
        strength_px: 95th percentile of |w|; 0 without a plume.
        place: Number of the place.
        poses: Whose poses the run had: its `own`, or those that the plume was rendered with.
        cpu_s: Of the run.
        failure: Why there is no map.
        found: The plume is in the map; None without one.
        error_percent: Of its source, percent of the range.
        nees: Its squared error against the stated covariance, 3 expected.
        false_plumes: Plumes and directions that are none.
        limit_px: What the map states that would have been seen.
        mean_px: Mean true |w| inside the plume, median over the frames: limits are stated so.
        silent_share: Share of the frames without any evidence.
        sigma_px: Median over frames of the median sigma.
        informed: The same by the normal equations of the displacement.
        signal: What they say for the true displacement, against their scatter elsewhere, median
            over frames.
        ratio: Measured over true displacement inside the plume, median over frames.
        thirds: The same by third of each of `THIRDS`.
    """

    recording: str
    strength_px: float
    place: int | None
    poses: str
    cpu_s: float
    failure: str = ""
    found: bool | None = None
    error_percent: float | None = None
    nees: float | None = None
    false_plumes: int | None = None
    limit_px: float | None = None
    mean_px: float | None = None
    silent_share: float | None = None
    sigma_px: float | None = None
    informed: float | None = None
    signal: float | None = None
    ratio: float | None = None
    thirds: dict[str, Thirds] | None = None

    def save(self, path: Path) -> None:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(self.line() + "\n")

    def line(self) -> str:
        """One line of JSON."""
        return json.dumps(to_plain_values(asdict(self), null_for_nan=True), allow_nan=False)

    @classmethod
    def load(cls, path: Path) -> Self:
        content: dict[str, Any] = json.loads(path.read_text())
        return cls(**content)


def median(values: Sequence[float]) -> float | None:
    """The median of what is finite; None where nothing is."""
    finite = [value for value in values if np.isfinite(value)]
    return float(np.median(finite)) if finite else None


def score_map(case: Case, run: Path, plume_map: PlumeMap, poses: str, cpu_s: float) -> CaseScore:
    """Scores a finished run."""
    files = RunFiles(run)
    _, indices, found = load_detections(files.detections)
    trajectory = Trajectory.load(files.trajectory) if files.trajectory.exists() else None
    score = CaseScore(
        recording=case.recording.name,
        strength_px=case.strength_px,
        place=case.place,
        poses=poses,
        cpu_s=cpu_s,
        false_plumes=len(plume_map.plumes) + len(plume_map.bearings),
        limit_px=plume_map.detection_limit_px,
        silent_share=silent_share(found),
        sigma_px=median([median_sigma(detection) for detection in found]),
    )
    if case.place is None:
        return score
    evaluation = evaluate_map(plume_map, trajectory, case.film)
    hits = evaluation.plumes
    ratios = [] if trajectory is None else ratios_of(case, files, trajectory, indices, found)
    return replace(
        score,
        found=not evaluation.misses,
        error_percent=hits[0].error_percent if hits else None,
        nees=hits[0].nees if hits else None,
        false_plumes=len(evaluation.false_plumes),
        mean_px=median([each.mean_px for each in ratios]),
        informed=median([each.informed for each in ratios]),
        signal=median([each.signal for each in ratios]),
        ratio=median([each.inside for each in ratios]),
        thirds=thirds_of(ratios),
    )


def ratios_of(
    case: Case,
    files: RunFiles,
    trajectory: Trajectory,
    indices: Sequence[int],
    found: Sequence[Detection],
) -> list[FrameRatios]:
    truth = SceneTruth.load(case.film)
    camera = trajectory.camera
    images = FrameImages([files.frames / f"{index:06d}.png" for index in indices], camera)
    ratios = []
    for k, (index, detection) in enumerate(zip(indices, found, strict=True)):
        true = truth.frame(index)
        if true is not None:
            w = true_in_undistorted(true.displacement, camera)
            information = detection.information
            by_frame = frame_ratios(
                detection.displacement,
                np.isfinite(detection.sigma_px),
                w,
                images[k],
                detection.inverse_depth,
            )
            if information is not None:
                by_frame = replace(
                    by_frame,
                    informed=informed_over_true(information, w),
                    signal=signal_over_noise(information, w),
                )
            ratios.append(by_frame)
    return ratios


def thirds_of(ratios: Sequence[FrameRatios]) -> dict[str, Thirds]:
    """The median over frames of each third."""
    return {
        name: [median([each.thirds[name][k] for each in ratios]) for k in range(3)]
        for name in THIRDS
    }


def silent_share(found: Sequence[Detection]) -> float:
    """Share of the frames without any evidence."""
    return float(np.mean([not each.llr.any() for each in found]))


def median_sigma(detection: Detection) -> float:
    """Of what was measured, px; NaN where nothing was."""
    known = np.isfinite(detection.sigma_px)
    return float(np.median(detection.sigma_px[known])) if known.any() else float("nan")
