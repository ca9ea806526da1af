"""Pixel scores of the registered detector against simulated truth.

    python -m benchmarks.registered pixels SIMULATION... [--pose-errors 0 0.03 0.1] [--frames 5]

A pixel is positive where the truth's mask holds and the background is a surface, negative where a
surface is seen undisplaced (under 0.1 px); sky and weak fringes count as neither.
"""

import argparse
import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import av
import numpy as np
from scipy.spatial.transform import Rotation

from detect.detection import Detection, Frames
from detect.registered import RegisteredDetector
from detect.scores import auroc, average_precision
from geometry.arrays import BoolArray, FloatArray
from geometry.trajectory import Trajectory

WEAK_PX = 0.1
SHIFT_PER_DEG = 0.15


@dataclass(frozen=True, kw_only=True)
class PixelTruth:
    displacement: FloatArray
    plume: BoolArray
    clear: BoolArray

    @classmethod
    def load(cls, folder: Path, index: int) -> "PixelTruth":
        with np.load(folder / f"truth/{index:06d}.npz", allow_pickle=False) as file:
            displacement = file["displacement"].astype(float)
            surface = np.isfinite(file["depth"])
            plume = file["mask"] & surface
        weak = np.linalg.norm(displacement, axis=-1) < WEAK_PX
        return cls(displacement=displacement, plume=plume, clear=surface & weak & ~plume)


def load(folder: Path) -> Frames:
    with av.open(str(folder / "video.mkv")) as video:
        images = [
            np.asarray(frame.to_ndarray(format="gray"), np.uint8) for frame in video.decode(video=0)
        ]
    return Frames(images=images, trajectory=Trajectory.load(folder / "truth.json"))


def with_pose_error(frames: Frames, error_deg: float) -> Frames:
    """Independent errors per frame: `error_deg` about every axis, 0.15 units per degree."""
    trajectory, rng = frames.trajectory, np.random.default_rng(0)
    assert trajectory is not None
    turns = rng.normal(0, np.deg2rad(error_deg), (len(trajectory), 3))
    rotations = Rotation.from_rotvec(turns).as_matrix() @ trajectory.rotations
    shifts = rng.normal(0, error_deg * SHIFT_PER_DEG, (len(trajectory), 3))
    centers = trajectory.centers_in_world + shifts
    translations = -np.einsum("nij,nj->ni", rotations, centers)
    return replace(
        frames, trajectory=replace(trajectory, rotations=rotations, translations=translations)
    )


def detections(frames: Frames, count: int) -> Iterator[tuple[int, Detection, float]]:
    detector = RegisteredDetector()
    for index in np.linspace(4, len(frames) - 5, count).round().astype(int):
        start = time.process_time()
        yield int(index), detector.detect(frames, int(index)), time.process_time() - start


def score_row(folder: Path, frames: Frames, count: int) -> str:
    llrs, sizes, labels, errors, silence, false, seconds = [], [], [], [], [], [], []
    for index, detection, spent in detections(frames, count):
        truth = PixelTruth.load(folder, index)
        judged = truth.plume | truth.clear
        llrs.append(detection.llr[judged])
        sizes.append(np.linalg.norm(detection.displacement, axis=-1)[judged])
        labels.append(truth.plume[judged])
        error = np.linalg.norm(detection.displacement - truth.displacement, axis=-1)
        errors.append(error[truth.plume])
        silence.append(np.linalg.norm(truth.displacement, axis=-1)[truth.plume])
        false.append((detection.llr[truth.clear] > 1).mean())
        seconds.append(spent)
    llr, size, label = (np.concatenate(parts) for parts in (llrs, sizes, labels))
    error, zero = np.concatenate(errors), np.concatenate(silence)
    found = (llr[label] > 1).mean() if label.any() else np.nan
    return (
        f"{auroc(llr, label):.3f} / {average_precision(llr, label):.3f}   "
        f"{auroc(size, label):.3f} / {average_precision(size, label):.3f}   {label.mean():.3f}   "
        f"{error.mean() if error.size else np.nan:.3f} / {zero.mean() if zero.size else np.nan:.3f}"
        f"   {found:.2f} / {np.mean(false):.4f}   {np.mean(seconds):.2f}"
    )


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("simulations", nargs="+", type=Path)
    parser.add_argument("--pose-errors", nargs="+", type=float, default=[0.0, 0.03, 0.1])
    parser.add_argument("--frames", type=int, default=5)


def main(options: argparse.Namespace) -> None:
    print("scene, pose error: llr AUROC / AP   |w| AUROC / AP   prior   EPE / of zero, px   "
          "llr > 1 in / out   CPU s a frame")  # fmt: skip
    for folder in options.simulations:
        frames = load(folder)
        for error_deg in options.pose_errors:
            scores = score_row(folder, with_pose_error(frames, error_deg), options.frames)
            print(f"{folder.name}, {error_deg:.2f} deg: {scores}", flush=True)
