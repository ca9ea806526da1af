"""What is compared: the null, the waves, the refinement network, and each network."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from detect.calibration import posterior_probability
from detect.detection import Detection
from detect.dybs import DybsDetector
from detect.dybs.detector import CLASS_NAMES
from detect.dybs.estimator import WHITE, Estimate, RefinedMeasurement, combine_estimates
from detect.dybs.pattern_measurement import PatternMeasurement
from detect.network import Network
from geometry.arrays import FloatMap, GreyImage

MASK_NATS = 2.0
POOL_PX, WAVES_FLOOR = 5.0, 0.3
"""The floor keeps the logarithm of still air finite."""


@dataclass(frozen=True, kw_only=True)
class Answer:
    """Of one contender on one image, (H, W) each; None where it does not say."""

    score: FloatMap
    displacement: FloatMap | None = None
    probability: FloatMap | None = None
    llr: FloatMap | None = None


def planes(image: GreyImage, channels: int = 1) -> FloatMap:
    return np.broadcast_to(image.astype(np.float32) / np.float32(WHITE), (channels, *image.shape))


class Contenders:
    """Everything that is compared."""

    def __init__(self, paths: Sequence[Path], null: FloatMap) -> None:
        self._detectors = {Network(path).name: DybsDetector(path) for path in paths}
        self._null = null

    def answers(self, image: GreyImage) -> Iterator[tuple[str, Answer]]:
        yield "null", Answer(score=self._null)
        measurement = RefinedMeasurement.of_image(
            image, next(iter(self._detectors.values())).estimator.refinement
        )
        yield "waves alone", waves_alone(measurement.measured, image.shape)
        says = measurement.refined or {"logit": np.zeros(image.shape, np.float32)}
        yield "refinement alone", Answer(score=says["logit"], displacement=says.get("displacement"))
        for name, detector in self._detectors.items():
            seen = detector.estimator.network_maps(image)
            yield f"{name} alone", Answer(score=seen["logit"], displacement=seen["displacement"])
            estimate = combine_estimates(seen, measurement)
            judged = detector.to_detection(estimate)
            yield (
                f"dybs, {name}",
                Answer(
                    score=unbounded(detector, estimate),
                    displacement=judged.displacement,
                    probability=probability(detector, estimate, judged),
                    llr=judged.llr,
                ),
            )


def waves_alone(measured: PatternMeasurement, shape: tuple[int, ...]) -> Answer:
    """The waves' displacement; its score is the size in their own sigmas, pooled."""
    displacement = measured.displacement * measured.lattice[..., None]
    size_px = np.linalg.norm(displacement, axis=-1).astype(np.float32)
    pooled = cv2.GaussianBlur(size_px, (0, 0), POOL_PX / 2) * np.sqrt(measured.certainty)
    score = np.where(measured.lattice, np.log(pooled + WAVES_FLOOR), 0)
    size = (2 * score.shape[1], 2 * score.shape[0])
    inside = tuple(slice(side) for side in shape)
    return Answer(
        score=cv2.resize(score.astype(np.float32), size)[inside],
        displacement=cv2.resize(displacement, size)[inside],
    )


def unbounded(detector: DybsDetector, estimate: Estimate) -> FloatMap:
    calibration = detector.calibration
    bounds = (-np.inf, np.inf)
    return calibration.llr(estimate.scores, estimate.texture, CLASS_NAMES, most=bounds)


def probability(detector: DybsDetector, estimate: Estimate, seen: Detection) -> FloatMap:
    """What the evidence makes of each class's share of positives in the validation samples."""
    stated = np.full(seen.llr.shape, np.nan, np.float32)
    for name, scale in detector.calibration.scales.items():
        members = estimate.texture == CLASS_NAMES.index(name)
        stated[members] = posterior_probability(seen.llr[members], scale.prior)
    return stated
