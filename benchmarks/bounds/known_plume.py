"""What the measured frames of finished runs hold of a plume whose displacement is known.

    python -m benchmarks.bounds known-plume work/physical/air_0.12m_at_8.5m_1280px_60_13000 \\
        --runs run_video_usual run_h264_0.2_usual run_h265_0.1_usual

For each run, over its measured frames: the sigmas of the true displacement in the information of a
frame (mean and least), those of all frames together, and the share of its size that is measured.
The noise is what the same displacement shows elsewhere in the frame. This is what the search could
reach at most, did it know the plume.
"""

import argparse
from itertools import product
from pathlib import Path

import cv2
import numpy as np

from benchmarks.common.csv_tables import Row, write_table
from detect.information import DisplacementInformation
from geometry.arrays import FloatMap
from locate.pipeline.detections import load_detections

SHIFTS = (-160, -120, -80, 80, 120, 160)
"""By how many cells along x the displacement is shifted for the noise."""
LIFTS = (-40, 0, 40)
"""Along y."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("scene", type=Path, help="Folder with truth/ and the runs.")
    parser.add_argument("--runs", nargs="+", required=True, help="Folders of runs in it.")
    parser.add_argument("--out", type=Path, default=Path("work"))


def main(options: argparse.Namespace) -> None:
    rows = [run_row(options.scene, name) for name in options.runs]
    write_table(options.out / "bounds_known_plume.csv", rows)


def run_row(scene: Path, name: str) -> Row:
    """What the frames of one run hold."""
    sigmas, shares = [], []
    _, indices, detections = load_detections(scene / name / "detections")
    for index, detection in zip(indices, detections, strict=True):
        if detection.information is None:
            continue
        with np.load(scene / "truth" / f"{index:06d}.npz", allow_pickle=False) as truth:
            displacement = np.asarray(truth["displacement"], np.float32)
        of_frame, share = known_plume_sigmas(detection.information, displacement)
        sigmas.append(of_frame)
        shares.append(share)
    return {
        "run": name,
        "frames": str(len(sigmas)),
        "sigmas a frame": f"{np.mean(sigmas):.2f}",
        "least": f"{np.min(sigmas):.2f}",
        "sigmas of all": f"{np.sum(sigmas) / np.sqrt(len(sigmas)):.1f}",
        "share of its size": f"{np.mean(shares):.2f}",
    }


def known_plume_sigmas(
    information: DisplacementInformation, displacement: FloatMap
) -> tuple[float, float]:
    """The sigmas of a displacement (H, W, 2) in the information, and the share of it measured."""
    height, width = information.matrix.shape[:2]
    size = (width, height)
    small = np.asarray(cv2.resize(displacement, size, interpolation=cv2.INTER_AREA), np.float32)
    score, variance = matched_sums(information, small)
    elsewhere = [
        matched_sums(information, np.roll(small, (lift, shift), axis=(0, 1)))
        for shift, lift in product(SHIFTS, LIFTS)
    ]
    noise = np.std([each / np.sqrt(spread) for each, spread in elsewhere])
    return float(score / np.sqrt(variance) / noise), float(score / variance)


def matched_sums(information: DisplacementInformation, shape: FloatMap) -> tuple[float, float]:
    """The score of a displacement (h, w, 2) of size 1, and its variance."""
    x, y = shape[..., 0], shape[..., 1]
    xx, xy, yy = np.moveaxis(information.matrix, -1, 0)
    variance = (x * x * xx + 2 * x * y * xy + y * y * yy).sum()
    return float((shape * information.vector).sum()), float(variance)
