"""What the measured frames of finished runs hold of a plume whose displacement is known.

    python -m benchmarks.bounds known-plume work/physical/air_0.12m_at_8.5m_1280px_60_13000 \\
        --runs run_video_usual run_h264_0.2_usual run_h265_0.1_usual

For each run, over its measured frames: the sigmas of the true displacement in the information of a
frame (mean and least, and the mean of the frames coded as B frames and of the others), those of all
frames together, and the share of its size that is measured.
The noise is what the same displacement shows elsewhere in the frame. This is what the search could
reach at most, did it know the plume.
"""

import argparse
from pathlib import Path

import numpy as np

from benchmarks.common.csv_tables import Row, write_table
from benchmarks.real_frames.displacement import informed_over_true, signal_over_noise
from benchmarks.scenes.limit import true_displacement
from geometry.arrays import FloatArray
from locate.pipeline.detections import load_detections
from locate.recording import KeyFrames


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("scene", type=Path, help="Folder with truth/ and the runs.")
    parser.add_argument("--runs", nargs="+", required=True, help="Folders of runs in it.")
    parser.add_argument("--out", type=Path, default=Path("work"))


def main(options: argparse.Namespace) -> None:
    rows = [run_row(options.scene, name) for name in options.runs]
    write_table(options.out / "bounds_known_plume.csv", rows)


def run_row(scene: Path, name: str) -> Row:
    """What the frames of one run hold."""
    sigmas, shares, coded_as_b = [], [], []
    _, indices, detections = load_detections(scene / name / "detections")
    b_frames = KeyFrames.load(scene / name / "frames" / "index.json").b_frames
    for index, detection in zip(indices, detections, strict=True):
        if detection.information is None:
            continue
        displacement = true_displacement(scene, index)
        sigmas.append(signal_over_noise(detection.information, displacement))
        shares.append(informed_over_true(detection.information, displacement))
        coded_as_b.append(index in b_frames)
    is_b = np.array(coded_as_b, bool)
    return {
        "run": name,
        "frames": str(len(sigmas)),
        "sigmas a frame": f"{np.mean(sigmas):.2f}",
        "least": f"{np.min(sigmas):.2f}",
        "a B frame": _mean(np.array(sigmas)[is_b]),
        "another frame": _mean(np.array(sigmas)[~is_b]),
        "sigmas of all": f"{np.sum(sigmas) / np.sqrt(len(sigmas)):.1f}",
        "share of its size": f"{np.mean(shares):.2f}",
    }


def _mean(sigmas: FloatArray) -> str:
    return f"{np.mean(sigmas):.2f}" if len(sigmas) else ""
