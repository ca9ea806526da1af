"""The single-frame detector, taught the user's own background in a minute or two."""

import json
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import chain
from pathlib import Path

import numpy as np

from detect.calibration import Calibration
from detect.dybs.detector import SCORES
from detect.dybs.estimator import SingleFrameEstimator
from detect.learning.dybs_calibration import PLUME_PX, calibrate, labels_of
from detect.scores import auroc
from detect.synthesis import Sample, Shard
from detect.synthesis.own_images import HALF_SCALE, sample_hazy_images, sample_own_images
from geometry.arrays import GreyImage
from geometry.atomic import atomic_path
from geometry.reports import Report

HELD_OUT = 5
"""Of so many images, one is not learned from."""
CROPS_PER_MINUTE, STEPS_PER_MINUTE = 300, 500
"""About what a thread of an ordinary processor does."""
SAMPLES = 16
"""Samples of each set that a network is watched, calibrated or scored by."""
WHOLE_PX = 512
"""Larger than what is learned from: what it learned of the edges of samples must not count."""
THINNED = 5
"""Of so many rows and columns of pixels, one is scored: neighbours say the same."""
NO_EVIDENCE = Calibration(scores=SCORES, scales={})
"""Of a network that learned from one image: its noise is a part of what it knows, and samples of
that same image would call evidence what is other noise."""


@dataclass(frozen=True, kw_only=True)
class Score:
    """How well a network sees plumes that it was not trained on.

    Attributes:
        auroc: Of its logit, displaced pixels against still ones.
        correlation: Of its displacement with the true one, over all pixels.
        error_px: Mean length of its displacement's error where there is a plume.
        zero_error_px: The same for an answer of zero.
    """

    auroc: float
    correlation: float
    error_px: float
    zero_error_px: float


@dataclass(frozen=True, kw_only=True)
class Adapted:
    """What adapting did.

    Attributes:
        learned: From how many images.
        held_out: How many others it was scored on; 0 where there was but one, which was then
            scored through other plumes.
        before: The network it began with, on the same samples.
        after: The adapted one.
        reliable_classes: The texture classes that it has evidence in; none from a single image.
    """

    learned: int
    held_out: int
    before: Score
    after: Score
    reliable_classes: tuple[str, ...]


def adapt(
    start: Path,
    images: Sequence[GreyImage],
    path: Path,
    *,
    minutes: float = 2.0,
    seed: int = 0,
    report: Report,
) -> Adapted:
    """Fine-tunes a network on images of one's own, calibrates it, and writes it.

    It learns at half the images' size, where synthesis cannot leak, and its file states this by
    `scale`. How many samples and steps a minute has is fixed, about what a thread of an ordinary
    processor does: the result does not depend on how busy the machine is.

    Args:
        start: The .onnx file to begin with, fp32.
        images: Without a plume.
        path: The .onnx file to write.
        minutes: About half goes into samples, half into steps.
        seed: Of every random choice.
        report: Called with the progress, (what, share done).

    Raises:
        BadInputError: The start is not a network of ours, an image is too small, or PATH cannot
            be written.
    """
    from detect.learning.adapt import fine_tune

    SingleFrameEstimator(start)
    learned, held = divided(images)
    haze, plumes = _draw_samples(learned, minutes, seed, report)
    watched = sample_own_images(held, SAMPLES, seed=seed + 2, scale=HALF_SCALE)
    with atomic_path(path) as unfinished:
        fine_tune(
            start,
            haze,
            plumes,
            watched,
            unfinished,
            steps=max(round(minutes * STEPS_PER_MINUTE), 2),
            data=f"{len(learned)} images of its user",
            metadata={"scale": str(HALF_SCALE), "calibration": json.dumps(NO_EVIDENCE.to_plain())},
            report=report,
        )
        report("calibration", 0)
        is_single = held is learned
        calibration = NO_EVIDENCE if is_single else _calibrate_on(unfinished, held, seed + 3)
        scored = sample_own_images(held, SAMPLES, seed=seed + 4, scale=1, largest_px=WHOLE_PX)
        answer = Adapted(
            learned=len(learned),
            held_out=0 if is_single else len(held),
            before=score(start, each(scored)),
            after=score(unfinished, each(scored)),
            reliable_classes=tuple(calibration.scales),
        )
    report("calibration", 1)
    return answer


def _draw_samples(
    images: Sequence[GreyImage], minutes: float, seed: int, report: Report
) -> tuple[Shard, Shard]:
    """What is learned from: samples with haze, and samples with plumes."""
    crops = max(round(minutes * CROPS_PER_MINUTE / 2), 1)
    haze = sample_hazy_images(
        images,
        crops,
        seed=seed,
        scale=HALF_SCALE,
        progress=lambda share: report("samples", share / 2),
    )
    plumes = sample_own_images(
        images,
        crops,
        seed=seed + 1,
        scale=HALF_SCALE,
        progress=lambda share: report("samples", (1 + share) / 2),
    )
    report("samples", 1)
    return haze, plumes


def _calibrate_on(weights: Path, images: Sequence[GreyImage], seed: int) -> Calibration:
    """Calibrates a network's file on images that it has not learned from."""
    plumes = sample_own_images(images, SAMPLES, seed=seed, scale=1, largest_px=WHOLE_PX)
    repeats = -(-SAMPLES // len(images))
    return calibrate(weights, chain(each(plumes), as_they_are(images, repeats)))


def divided(images: Sequence[GreyImage]) -> tuple[Sequence[GreyImage], Sequence[GreyImage]]:
    """The images to learn from, and those to score by; a single one is both."""
    if len(images) < 2:
        return images, images
    held = set(range(HELD_OUT // 2, len(images), HELD_OUT)) or {len(images) - 1}
    learned = [images[i] for i in range(len(images)) if i not in held]
    return learned, [images[i] for i in sorted(held)]


def each(shard: Shard) -> Iterable[Sample]:
    """The samples of a shard."""
    return (shard.sample_at(i) for i in range(len(shard)))


def as_they_are(images: Sequence[GreyImage], repeats: int) -> Iterable[Sample]:
    """The images themselves as samples of still air: no synthesis replaces a real frame."""
    for image in images:
        still = np.zeros((*image.shape, 2), np.float32)
        mask = np.zeros(image.shape, dtype=bool)
        for _ in range(repeats):
            yield Sample(image=image, displacement=still, mask=mask, family="photo")


def score(weights: Path, samples: Iterable[Sample]) -> Score:
    """Scores a network's file as it would be used, whatever its `scale`."""
    estimator = SingleFrameEstimator(weights)
    thin = (slice(None, None, THINNED),) * 2
    logits, plumes, found, true = [], [], [], []
    for sample in samples:
        estimate = estimator.estimate(sample.image)
        plume, counts = (map_[thin] for map_ in labels_of(sample))
        logits.append(estimate.scores[thin][counts][:, 0])
        plumes.append(plume[counts])
        found.append(estimate.displacement[thin].reshape(-1, 2))
        true.append(sample.displacement[thin].reshape(-1, 2))
    estimated, present = np.concatenate(found), np.concatenate(true)
    size_px = np.linalg.norm(present, axis=-1)
    plume = size_px > PLUME_PX
    error_px = np.linalg.norm(estimated - present, axis=-1)
    return Score(
        auroc=auroc(np.concatenate(logits), np.concatenate(plumes)),
        correlation=float(np.corrcoef(estimated.ravel(), present.ravel())[0, 1]),
        error_px=float(error_px[plume].mean()),
        zero_error_px=float(size_px[plume].mean()),
    )
