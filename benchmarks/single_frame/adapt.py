"""What adapting to a background brings: the single-frame network before and after.

    python -m benchmarks.single_frame adapt photos PHOTOS NETWORK.onnx [--runs RUNS]
    python -m benchmarks.single_frame adapt pairs PAIRS NETWORK.onnx [--minutes 2]

`photos`: of each held-out photo (the test split), views of a camera at half the photo's size are
made: 10 without a plume, which the network learns from, and 24 through plumes it has not seen
(simulated runs of the test split with --runs), which it is judged on; no image is interpolated.
Each view has its own sensor noise; the camera stands still.

`pairs`: the reference image of each real pair is learned from, the distorted one judged; truth is
the two-frame flow of `bos`, which is no independent truth. A pixel is a plume where that is above
three times its sigma and 0.2 px, still where it is below 0.1 px.

`two frames` is Lucas-Kanade between the mean of what was learned from and what is judged: about
the most that knowing the background can bring.
"""

import argparse
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from detect.bos import BosDetector
from detect.detection import Frames
from detect.differential import lucas_kanade
from detect.dybs import DybsDetector
from detect.dybs.estimator import SingleFrameEstimator
from detect.learning.background_adaptation import adapt
from detect.scores import auroc, average_precision
from detect.synthesis import Recipe, Sample, Sources
from detect.synthesis.camera import OVERSAMPLING
from detect.synthesis.flows import runs_in
from detect.synthesis.raster import REACH_PX, as_background, canvas_side, find_photos
from detect.synthesis.sample import render_through_plume
from geometry.arrays import BoolArray, FloatMap, GreyImage
from locate.pipeline.frame_by_frame import MASK_NATS
from locate.recording.images import read_grey

KNOWN, VIEWS, LARGEST_VIEW_PX = 10, 24, 320
PAIRS = {
    "blowtorch_plume": ("sop_enc_test_000.tif", "sop_enc_test_001.tif"),
    "supersonic_jet": ("A000.tif", "A001.tif"),
}
THINNED = 3


@dataclass(frozen=True, kw_only=True)
class DistortedImage:
    """One distorted image and what is true of it."""

    image: GreyImage
    displacement: FloatMap
    plume: BoolArray
    still: BoolArray


def of_sample(sample: Sample) -> DistortedImage:
    size_px = np.linalg.norm(sample.displacement, axis=-1)
    return DistortedImage(
        image=sample.image,
        displacement=sample.displacement,
        plume=size_px > 0.06,
        still=size_px < 0.02,
    )


def views(photo: GreyImage, seed: int, runs: tuple[Path, ...]) -> Iterator[Sample]:
    """What a still camera sees before a photo: at first nothing but it, then plumes."""
    largest = min(min(photo.shape) // 2 - 2 * REACH_PX, LARGEST_VIEW_PX)
    size_px = largest // 16 * 16
    side = canvas_side(size_px)
    crop = side * 2 // OVERSAMPLING
    y, x = ((n - crop) // 2 for n in photo.shape)
    part = photo[y : y + crop, x : x + crop].astype(np.float32) / 255
    enlarged = cv2.resize(part, (side, side), interpolation=cv2.INTER_CUBIC)
    background = as_background(np.clip(enlarged, 0, 1))
    for k in range(KNOWN + VIEWS):
        recipe = Recipe(
            size_px=size_px,
            families={"photo": 1},
            photos=Path(),
            negatives=1.0 if k < KNOWN else 0.2,
            plume_length=(0.5, 2.0),
            gamma=(1, 1),
            psf_sigma_px=(0.45, 0.45),
            jpeg_share=0,
        )
        rng = np.random.default_rng([seed, k])
        yield render_through_plume(background, "photo", rng, recipe, Sources(runs=runs), shift_px=0)


def of_pair(reference: GreyImage, image: GreyImage) -> DistortedImage:
    found = BosDetector(reference=reference).detect(Frames(images=[image]), 0)
    size_px = np.linalg.norm(found.displacement, axis=-1)
    return DistortedImage(
        image=image,
        displacement=found.displacement,
        plume=(size_px > 3 * found.sigma_px) & (size_px > 0.2),
        still=size_px < 0.1,
    )


def row(weights: Path, judged: list[DistortedImage]) -> str:
    """AUROC / AP of the logit, r, error / of zero, and share of still pixels above 2 nats."""
    estimator, thin = SingleFrameEstimator(weights), (slice(None, None, THINNED),) * 2
    calibrated = estimator.network.read_metadata("calibration") is not None
    detector = DybsDetector(weights) if calibrated else None
    scores, labels, found, true, said, pixels, errors, sizes = [], [], [], [], [], [], [], []
    for one in judged:
        estimate = estimator.estimate(one.image)
        counts = (one.plume | one.still)[thin]
        scores.append(estimate.scores[thin][counts][:, 0])
        labels.append(one.plume[thin][counts])
        found.append(estimate.displacement[thin].reshape(-1))
        true.append(one.displacement[thin].reshape(-1))
        error = np.linalg.norm(estimate.displacement - one.displacement, axis=-1)
        errors.append(error[one.plume])
        sizes.append(np.linalg.norm(one.displacement, axis=-1)[one.plume])
        if detector is not None:
            llr = detector.to_detection(estimate).llr
            masks = llr > MASK_NATS
            said.append([masks[one.plume].sum(), masks[one.still].sum()])
            pixels.append([one.plume.sum(), one.still.sum()])
    score, label = np.concatenate(scores), np.concatenate(labels)
    r = np.corrcoef(np.concatenate(found), np.concatenate(true))[0, 1]
    hit, false = np.sum(said, axis=0) / np.sum(pixels, axis=0) if said else (np.nan, np.nan)
    return (
        f"{auroc(score, label):.3f} / {average_precision(score, label):.3f} ({label.mean():.3f})   "
        f"{r:.3f}   {np.concatenate(errors).mean():.3f} / {np.concatenate(sizes).mean():.3f}   "
        f"{hit:.3f} / {false:.4f}"
    )


def two_frames(known: GreyImage, judged: list[DistortedImage]) -> str:
    found = [lucas_kanade(known, one.image) for one in judged]
    true = [one.displacement for one in judged]
    r = np.corrcoef(np.ravel(found), np.ravel(true))[0, 1]
    errors = [np.linalg.norm(f - one.displacement, axis=-1)[one.plume]
              for f, one in zip(found, judged, strict=True)]  # fmt: skip
    return f"r {r:.3f}, error in plumes {np.concatenate(errors).mean():.3f} px"


def compare(
    name: str, known: list[GreyImage], judged: list[DistortedImage], start: Path, minutes: float
) -> None:
    size = f"{known[0].shape[1]}x{known[0].shape[0]}"
    mean = np.rint(np.mean(known, axis=0)).astype(np.uint8)
    print(f"{name} {size}, two frames: {two_frames(mean, judged)}")
    print(f"{name} {size}, plain:   {row(start, judged)}", flush=True)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "adapted.onnx"
        began = time.process_time()
        adapt(start, known, path, minutes=minutes, report=lambda *_: None)
        spent = time.process_time() - began
        heard = ", ".join(
            (SingleFrameEstimator(path).network.read_metadata("calibration") or {})["classes"]
        )
        print(
            f"{name} {size}, adapted: {row(path, judged)}   {spent:.0f} CPU s, "
            f"heard: {heard or 'nothing'}",
            flush=True,
        )


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("kind", choices=["photos", "pairs"])
    parser.add_argument("folder", type=Path)
    parser.add_argument("network", type=Path)
    parser.add_argument("--runs", type=Path)
    parser.add_argument("--count", type=int, default=6)
    parser.add_argument("--minutes", type=float, default=2.0)


def main(options: argparse.Namespace) -> None:
    print("AUROC / AP (prior)   r   error in plumes / of zero, px   llr > 2 in plume / still")
    if options.kind == "pairs":
        for name, files in PAIRS.items():
            reference, image = (read_grey(options.folder / name / file) for file in files)
            judged = [of_pair(reference, image)]
            compare(name, [reference], judged, options.network, options.minutes)
        return
    photos = find_photos(options.folder, "test")
    chosen = np.linspace(len(photos) - 1, 0, options.count).astype(int)
    runs = runs_in(options.runs, "test") if options.runs else ()
    for k in chosen:
        seen = list(views(read_grey(photos[k]), int(k), runs))
        known = [sample.image for sample in seen[:KNOWN]]
        judged = [of_sample(sample) for sample in seen[KNOWN:]]
        compare(photos[k].stem, known, judged, options.network, options.minutes)
