"""Experiment 1: flows and backgrounds that nothing was trained on.

    OMP_NUM_THREADS=1 python -m benchmarks.paper unseen --samples TEST [--every 1]

Prints a row for each background, and draws one frame of each with `--picture`.
"""

import argparse
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from benchmarks.paper.rows import (
    HEADER,
    AnsweredFrame,
    add_detector_arguments,
    draw_strip,
    score_row,
    write_picture,
)
from detect.detection import Frames
from detect.dybs import DybsDetector
from detect.synthesis import FAMILIES, shards_in

RANKS = (0.7, 0.9)


def unseen(detector: DybsDetector, options: argparse.Namespace) -> list[np.ndarray]:
    """Samples of the test split with a plume, by background."""
    groups: dict[str, list[AnsweredFrame]] = {}
    for shard in shards_in(options.samples):
        for i in range(0, len(shard), options.every):
            sample = shard.sample_at(i)
            if not sample.displacement.any():
                continue
            everywhere = np.ones(sample.image.shape, dtype=bool)
            seen = AnsweredFrame(
                image=sample.image,
                truth=sample.displacement,
                answer=detector.detect(Frames(images=[sample.image]), 0),
                counts=everywhere,
                beside=~everywhere,
            )
            groups.setdefault(sample.family, []).append(seen)
    print(HEADER.format(what="background"))
    for family in FAMILIES:
        print(f"| {family} | {score_row(groups[family])} |", flush=True)
    return [
        np.hstack([
            draw_strip(seen.image, seen.truth, seen.answer.displacement, side=180)
            for seen in choose_ranks(groups[family], RANKS)
        ])
        for family in ("sinusoid", "checkerboard", "photo")
    ]  # fmt: skip


def choose_ranks(group: Sequence[AnsweredFrame], shares: Sequence[float]) -> list[AnsweredFrame]:
    """Frames by the rank of their mean displacement, 0 the weakest, 1 the strongest."""
    ordered = sorted(group, key=lambda seen: float(np.abs(seen.truth).mean()))
    return [ordered[round(share * (len(ordered) - 1))] for share in shares]


def add_arguments(parser: argparse.ArgumentParser) -> None:
    add_detector_arguments(parser)
    parser.add_argument("--samples", type=Path, required=True)
    parser.add_argument("--every", type=int, default=1)


def main(options: argparse.Namespace) -> None:
    write_picture(options.picture, unseen(DybsDetector(options.network), options))
