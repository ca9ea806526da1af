"""Teaches a network over registered neighbours what its scores are worth, and what it would see.

    python -m detect.learning.registered_calibration NETWORK.onnx --clips FOLDER
        [--seeds FIRST END]...

FOLDER holds clips of scenes that the network was not trained on. The file is written anew with
the calibration and the response in its metadata. Needs the `onnx` package (extra `train`).
"""

import argparse
import json
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from detect.calibration import Calibration
from detect.evidence import null_scale
from detect.learning.clips import TrainingClip, clip_seed, list_clips
from detect.registered.evidence_network import CLASS_NAMES, SCORES, EvidenceNetwork, NetworkOutput
from detect.registered.features import decode_feature
from detect.response import Response
from geometry.arrays import BoolArray, FloatMap
from geometry.errors import BadInputError, LocateError

THINNED = 4


@dataclass(frozen=True, kw_only=True)
class Read:
    """A frame of a training clip as a network reads it.

    Attributes:
        output: The network's.
        inputs: (C, H, W) what it read.
        truth: (H, W, 2) px.
        positive: (H, W) where there is plume.
        counts: (H, W) where a pixel is one or the other, and anything was measured.
        ratio: (H, W) the true |w| in units of the sigma that the detection states where still.
    """

    output: NetworkOutput
    inputs: FloatMap
    truth: FloatMap
    positive: BoolArray
    counts: BoolArray
    ratio: FloatMap


def read_clip(network: EvidenceNetwork, clip: TrainingClip) -> Iterator[Read]:
    """Its frames."""
    plume_px, still_px = clip.limits_px
    for inputs, truth in zip(clip.inputs, clip.visible_displacements(), strict=True):
        output = network.evaluate(inputs.astype(np.float32))
        size_px = np.linalg.norm(truth.astype(np.float32), axis=-1)
        yield Read(
            output=output,
            inputs=inputs,
            truth=truth.astype(np.float32),
            positive=size_px > plume_px,
            counts=((size_px > plume_px) | (size_px < still_px)) & output.measured,
            ratio=size_px / stated_sigma_px(inputs, output.measured),
        )


def stated_sigma_px(inputs: FloatMap, measured: BoolArray) -> FloatMap:
    """(H, W) px, of the displacements in (C, H, W) features; see `displacement_evidence`."""
    size_px = np.hypot(
        decode_feature(inputs, "displacement_x"), decode_feature(inputs, "displacement_y")
    )
    sigma_px = decode_feature(inputs, "log_sigma")
    scale = null_scale(size_px, sigma_px, decode_feature(inputs, "log_texture"), measured)
    return np.asarray(sigma_px * scale, dtype=np.float32)


def fitted(weights: Path, clips: Iterable[TrainingClip]) -> tuple[Calibration, Response | None]:
    """What clips show, by every `THINNED`-th row and column of their frames.

    Returns:
        The calibration; the response of the detector that it makes, None where none has evidence.
    """
    network = EvidenceNetwork(weights)
    thin = (slice(None, None, THINNED),) * 2
    parts = []
    for clip in clips:
        for read in read_clip(network, clip):
            output = read.output
            maps = output.scores, output.surfaces, read.positive, read.counts, read.ratio
            parts.append([one[thin][output.measured[thin]] for one in maps])
    scores, places, labels, counts, ratios = map(np.concatenate, zip(*parts, strict=True))
    calibration = Calibration.fit(
        scores[counts].astype(float),
        labels[counts],
        places[counts],
        score_names=SCORES,
        class_names=CLASS_NAMES,
    )
    llr = calibration.llr(scores, places, CLASS_NAMES)
    return calibration, Response.from_samples(ratios[llr != 0], llr[llr != 0])


def calibrate(weights: Path, clips: Iterable[TrainingClip]) -> Calibration:
    """Fits a network's calibration and response and writes them into its file.

    Args:
        weights: The .onnx file, which is replaced.
        clips: That neither the network was trained nor any figure is quoted on.

    Raises:
        BadInputError: The file is not a network over registered neighbours.
    """
    from detect.learning.export import write_metadata

    calibration, response = fitted(weights, clips)
    plain = {
        "calibration": calibration.to_plain(),
        "response": None if response is None else response.to_plain(),
    }
    write_metadata(weights, {key: json.dumps(content) for key, content in plain.items()})
    return calibration


def chosen(folders: Sequence[Path], spans: Sequence[tuple[int, int]]) -> list[Path]:
    """The clips of folders; where spans of seeds (first, after last) are given, only those.

    Raises:
        BadInputError: There are none.
    """
    paths = [path for folder in folders for path in list_clips(folder)]
    if spans:
        seeds = {seed for span in spans for seed in range(*span)}
        paths = [path for path in paths if clip_seed(path) in seeds]
    if not paths:
        raise BadInputError(f"{', '.join(map(str, folders))}: no clips; render some")
    return paths


def main(arguments: Sequence[str] | None = None) -> None:
    """The command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("network", type=Path)
    parser.add_argument("--clips", type=Path, nargs="+", required=True)
    parser.add_argument("--seeds", type=int, nargs=2, action="append", default=[])
    options = parser.parse_args(arguments)
    try:
        paths = chosen(options.clips, options.seeds)
        paths = [*paths[::2], *paths[1::2]]  # each half is scored by the other: all kinds in both
        calibration = calibrate(options.network, map(TrainingClip.load, paths))
    except LocateError as error:
        parser.exit(error.exit_code, f"{error}\n")
    for name in CLASS_NAMES:
        print(f"{options.network.name}, {name}: {calibration.scales.get(name) or 'no evidence'}")


if __name__ == "__main__":
    main()
