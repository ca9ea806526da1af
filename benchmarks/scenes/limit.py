"""Whether the stated detection limit is true: plumes of known strength put into a clean recording.

    python -m benchmarks.scenes limit --work work/orbit --seeds 1001 1002 1003 1004

Needs what `python -m benchmarks.scenes orbit --work work/orbit --seeds ...` leaves: the run of each
scene without a plume, and the true displacement of the same scene with one. That displacement,
scaled to a share of the stated limit, bends the clean frames; poses are kept, the detector and the
decision are repeated, once with nothing put in: that states the limit. The strength of a plume is
its mean displacement along the axis, as the limit is.
"""

import argparse
import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np
from scipy import ndimage

from benchmarks.scenes.coding import run_folder
from detect.fused import SEPARATOR
from detect.kinds import DYBS, REGISTERED
from detect.registry import KINDS, make_detector
from geometry.arrays import FloatMap, GreyImage
from geometry.image_files import read_image, write_image
from geometry.reports import ignore_report
from geometry.trajectory import Trajectory
from locate.evaluation import evaluate_map
from locate.map.plume import PlumeMap
from locate.pipeline.decide import fuse_detections
from locate.pipeline.detections import measure_frames
from locate.pipeline.effort import EFFORTS
from locate.pipeline.files import RunFiles
from locate.pipeline.points import load_points
from locate.pipeline.poses import frames_with_poses
from locate.recording import KeyFrames
from locate.recording.posed_frames import PosedFrames

DETECTORS = (*KINDS, REGISTERED.name + SEPARATOR + DYBS.name)
INSIDE_SHARE = 0.3


def load_posed_frames(run: Path, folder: Path) -> PosedFrames:
    """The frames of a finished run, its images taken from `folder`; none at full size."""
    files = RunFiles(run)
    posed = frames_with_poses(files, KeyFrames.load(files.frame_index))
    return replace(posed, folder=folder, full_size=None)


def true_displacement(scene: Path, index: int) -> FloatMap:
    with np.load(scene / "truth" / f"{index:06d}.npz", allow_pickle=False) as truth:
        return np.asarray(truth["displacement"], np.float32)


def mean_strength_px(scene: Path, indices: list[int]) -> float:
    """Mean |w| inside the plume: where it is above a share of the frame's largest."""
    means = []
    for index in indices:
        size = np.linalg.norm(true_displacement(scene, index), axis=-1)
        means.append(float(size[size > INSIDE_SHARE * np.quantile(size[size > 0], 0.95)].mean()))
    return float(np.mean(means))


def bend_image(image: GreyImage, displacement: FloatMap) -> GreyImage:
    """The image with pixel p showing what stood at p + w(p), by a cubic spline."""
    rows, columns = np.indices(image.shape, dtype=np.float32)
    where = [rows + displacement[..., 1], columns + displacement[..., 0]]
    values = ndimage.map_coordinates(image.astype(np.float32), where, order=3, mode="nearest")
    return np.asarray(np.clip(np.rint(values), 0, 255), np.uint8)


def find_inserted(
    clean: Path, leak: Path, factor: float, detector_name: str, most: int
) -> tuple[bool, PlumeMap]:
    """Whether a run finds the leak's plume at `factor` of its strength, and its map."""
    run = run_folder(clean / "video.mkv")
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        source = load_posed_frames(run, run / "frames")
        for image_name, index in zip(source.names, source.indices, strict=True):
            image = read_image(run / "frames" / image_name)
            displacement = factor * true_displacement(leak, int(index))
            write_image(folder / image_name, bend_image(image, displacement))
        points = load_points(run / "points.npz")
        if points is None:
            points = load_points(run / "sfm" / "points.npz")
        detector = make_detector(detector_name, points_in_world=points)
        inserted = replace(source, folder=folder)
        measure_frames(inserted, detector, folder / "detections", most=most, report=ignore_report)
        plume_map = fuse_detections(
            folder / "detections", inserted, folder / "evidence.npz", seed=0
        )
    assert source.trajectory is not None
    evaluation = evaluate_map(plume_map, source.trajectory, leak, None)
    return bool(evaluation.plumes), plume_map


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--seeds", type=int, nargs="+", default=[1001, 1002, 1003, 1004])
    parser.add_argument("--shares", type=float, nargs="+", default=[0.5, 1.0, 2.0])
    parser.add_argument("--work", type=Path, default=Path("work/orbit"))
    parser.add_argument("--detector", choices=DETECTORS, default=REGISTERED.name)


def main(options: argparse.Namespace) -> None:
    most = EFFORTS["usual"].detection_frames
    for seed in options.seeds:
        clean = options.work / f"clean_{seed}"
        leak = options.work / f"1px_1_{seed}"
        limit_px = find_inserted(clean, leak, 0.0, options.detector, most)[1].detection_limit_px
        if limit_px is None:
            print(f"{seed} | no limit stated")
            continue
        run = run_folder(clean / "video.mkv")
        indices = Trajectory.load(run / "trajectory.json").indices.tolist()
        strength_px = mean_strength_px(leak, indices)
        for share in options.shares:
            factor = share * limit_px / strength_px
            seen, plume_map = find_inserted(clean, leak, factor, options.detector, most)
            strongest = max((p.evidence_nats for p in plume_map.plumes), default=0.0)
            print(
                f"{seed} | stated {limit_px:.2f} px | inserted {share * limit_px:.2f} px | "
                f"{'found' if seen else 'missed'} | {strongest:.0f} nats",
                flush=True,
            )
