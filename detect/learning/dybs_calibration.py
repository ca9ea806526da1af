"""Teaches a network's file what its scores are worth.

    python -m detect.learning.dybs_calibration NETWORK.onnx... --samples FOLDER

FOLDER holds validation samples, as `detect.synthesis.render_dataset` writes them: of photos and
flows that the network was not trained on. The files are written anew with the calibration in their
metadata. Needs the `onnx` package (extra `train`).
"""

import argparse
import json
from collections.abc import Iterable, Sequence
from pathlib import Path

import cv2
import numpy as np

from detect.calibration import LEAST_AUROC, Calibration
from detect.dybs.detector import CLASS_NAMES, SCORES
from detect.dybs.estimator import SingleFrameEstimator
from detect.scores import auroc
from detect.synthesis import Sample, shards_in
from detect.synthesis.recipe import SAMPLE_FAMILIES
from detect.texture import Texture
from geometry.arrays import BoolArray, FloatMap
from geometry.errors import LocateError

PLUME_PX, STILL_PX = 0.06, 0.02
"""Displacements above are positive, below negative; those between count as neither."""
THINNED = 5
LEAST_SHARE = 0.1
"""Of a class: a kind of background that makes up as much of it must be separable by itself."""


def labels_of(sample: Sample) -> tuple[BoolArray, BoolArray]:
    """(H, W) where there is refraction, and where a pixel counts as one or the other."""
    size_px = np.linalg.norm(sample.displacement, axis=-1)
    return size_px > PLUME_PX, (size_px > PLUME_PX) | (size_px < STILL_PX)


def fitted(weights: Path, samples: Iterable[Sample]) -> Calibration:
    """The calibration of a network on samples, every `THINNED`-th row and column of them.

    Flat texture has no evidence, however its noise is shaped; nor has a class where one kind of
    background, hidden among others, separates nothing: edges of photos among printed lines.
    """
    estimator = SingleFrameEstimator(weights)
    thin = (slice(None, None, THINNED),) * 2
    parts = []
    for sample in samples:
        estimate = estimator.estimate(sample.image)
        positive, counts = (map_[thin] for map_ in labels_of(sample))
        counts &= estimate.texture[thin] != Texture.FLAT
        family = np.full(counts.sum(), SAMPLE_FAMILIES.index(sample.family))
        parts.append(
            (
                estimate.scores[thin][counts],
                positive[counts],
                estimate.texture[thin][counts],
                family,
            )
        )
    scores, labels, classes, families = (
        np.concatenate(column) for column in zip(*parts, strict=True)
    )
    calibration = Calibration.fit(
        scores.astype(float), labels, classes, score_names=SCORES, class_names=CLASS_NAMES
    )
    kept = {}
    for name, scale in calibration.scales.items():
        members = classes == CLASS_NAMES.index(name)
        llr = scale.llr(scores[members])
        if worst_family(llr, labels[members], families[members]) >= LEAST_AUROC:
            kept[name] = scale
    return Calibration(scores=SCORES, scales=kept)


def worst_family(llr: FloatMap, labels: BoolArray, families: np.ndarray) -> float:
    """The least AUROC among the kinds of background that make up a tenth of a class or more.

    Args:
        llr: (N,) of one class.
        labels: (N,) true where there is refraction.
        families: (N,) kind of background.
    """
    large = np.flatnonzero(np.bincount(families) >= LEAST_SHARE * len(families))
    return min(auroc(llr[families == k], labels[families == k]) for k in large)


def calibrate(weights: Path, samples: Iterable[Sample]) -> Calibration:
    """Fits a network's calibration and writes it into its file.

    Args:
        weights: The .onnx file, which is replaced.
        samples: That neither the network was trained nor any figure is quoted on.

    Raises:
        BadInputError: The file is not a single-frame network.
    """
    from detect.learning.export import write_metadata

    calibration = fitted(weights, samples)
    write_metadata(weights, {"calibration": json.dumps(calibration.to_plain())})
    return calibration


def main(arguments: Sequence[str] | None = None) -> None:
    """The command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("networks", nargs="+", type=Path)
    parser.add_argument("--samples", type=Path, required=True)
    options = parser.parse_args(arguments)
    cv2.setNumThreads(1)
    try:
        for path in options.networks:
            samples = (s.sample_at(i) for s in shards_in(options.samples) for i in range(len(s)))
            calibration = calibrate(path, samples)
            for name in CLASS_NAMES:
                scale = calibration.scales.get(name)
                print(f"{path.name}, {name}: {scale or 'no evidence'}", flush=True)
    except LocateError as error:
        parser.exit(error.exit_code, f"{error}\n")


if __name__ == "__main__":
    main()
