"""The evidence of each frame against the true mask and displacement."""

from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from detect.detection import Detection
from detect.scores import auroc, average_precision
from locate.evaluation.truth import SceneTruth, TruthFrame


@dataclass(frozen=True, kw_only=True)
class FrameScore:
    """How well a frame was seen.

    Attributes:
        index: Index of the frame.
        auroc: Of the evidence against the true mask; NaN where the mask is empty or full.
        average_precision: The same; `prior`, the share of the mask, is what chance gives.
        prior: Share of the frame that the mask covers.
        epe_px: Mean length of the displacement error within the mask; NaN where it is empty.
        epe_of_zero_px: The same for an answer of no displacement.
    """

    index: int
    auroc: float
    average_precision: float
    prior: float
    epe_px: float
    epe_of_zero_px: float


def frame_scores(detections_dir: Path, truth: SceneTruth) -> tuple[list[FrameScore], list[str]]:
    """Scores of every frame that has both a detection and a truth, and notes on them."""
    scores, resized = [], set()
    for index in truth.trajectory.indices.tolist():
        path, true = detections_dir / f"{index:06d}.npz", truth.frame(index)
        if true is None or not path.is_file():
            continue
        detection = Detection.load(path)
        if detection.llr.shape != true.mask.shape:
            resized.add((detection.llr.shape, true.mask.shape))
            detection = _resize_detection(detection, true.mask.shape)
        scores.append(_score_frame(index, detection, true))
    notes = [
        f"detections of {w} x {h} px were resized to the truth's {true_w} x {true_h} px"
        for (h, w), (true_h, true_w) in sorted(resized)
    ]
    return scores, notes


def _resize_detection(detection: Detection, shape: tuple[int, ...]) -> Detection:
    height, width = shape
    factor = np.array([width, height]) / detection.llr.shape[::-1]
    displacement, llr, sigma_px = (
        np.asarray(cv2.resize(array, (width, height), interpolation=cv2.INTER_LINEAR))
        for array in (detection.displacement, detection.llr, detection.sigma_px)
    )
    scaled = (displacement * factor).astype(np.float32)
    return Detection(
        displacement=scaled, sigma_px=sigma_px.astype(np.float32), llr=llr.astype(np.float32)
    )


def _score_frame(index: int, detection: Detection, true: TruthFrame) -> FrameScore:
    inside = true.displacement[true.mask]
    error = detection.displacement[true.mask] - inside
    return FrameScore(
        index=index,
        auroc=auroc(detection.llr, true.mask),
        average_precision=average_precision(detection.llr, true.mask),
        prior=float(true.mask.mean()),
        epe_px=_mean_length(error),
        epe_of_zero_px=_mean_length(inside),
    )


def _mean_length(vectors: np.ndarray) -> float:
    return float(np.linalg.norm(vectors, axis=-1).mean()) if len(vectors) else float("nan")
