"""Poses: our structure from motion beside pycolmap's own pipelines with their defaults.

    OMP_NUM_THREADS=1 python -m benchmarks.peers poses [DATA_DIR] [--rounds N] [--sets NAME ...]

Writes peers_poses.csv. Sets: `sample`, thirty frames of the bundled recording (a video of a
simulated plant), and `fountain`, eleven photos with ground truth. No focal length is given. The
peers take COLMAP's default features, matched with the next ten frames of a video or with every
photo; both mappers use the same. One thread each.
"""

import argparse
import tempfile
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pycolmap

from benchmarks import sfm
from benchmarks.common.csv_tables import DOCS, Row, write_table
from benchmarks.common.edited import video_of
from benchmarks.common.turns import ROUNDS, costs_of
from geometry.sfm import reconstruct, summary
from geometry.sfm.result import Reconstruction
from locate.recording import KeyFrames, open_recording, select_frames

OURS = "ours"
INCREMENTAL, GLOBAL = "pycolmap, incremental", "pycolmap, global"
FRAMES = 30
Models = dict[int, pycolmap.Reconstruction]


@dataclass(frozen=True, kw_only=True)
class PoseSet:
    """Key frames in a folder, and what their poses are held against."""

    folder: Path
    frames: KeyFrames
    measure: sfm.Measure


def sample_set(_: Path, work: Path) -> PoseSet:
    frames = select_frames(open_recording(video_of(sfm.SAMPLE)), work / "frames", max_frames=FRAMES)
    measure = sfm.against_simulation(sfm.SAMPLE / "truth.json")
    return PoseSet(folder=work / "frames", frames=frames, measure=measure)


def fountain_set(data: Path, work: Path) -> PoseSet:
    fountain = data / "2_sfm" / "strecha_fountain-P11"
    frames = select_frames(open_recording(fountain / "images_half"), work / "frames")
    measure = sfm.against_poses(sfm.strecha_truth(fountain))
    return PoseSet(folder=work / "frames", frames=frames, measure=measure)


SETS: dict[str, Callable[[Path, Path], PoseSet]] = {
    "sample": sample_set,
    "fountain": fountain_set,
}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("data", type=Path, nargs="?", default=sfm.DEFAULT_DATA)
    parser.add_argument("--rounds", type=int, default=ROUNDS)
    parser.add_argument("--sets", nargs="+", choices=SETS, default=list(SETS))
    parser.add_argument("--out", type=Path, default=DOCS)


def main(options: argparse.Namespace) -> None:
    pycolmap.logging.minloglevel = 3
    rows = []
    for name in options.sets:
        with tempfile.TemporaryDirectory() as work:
            pose_set = SETS[name](options.data, Path(work))
            rows += set_rows(name, pose_set, options.rounds)
    write_table(options.out / "peers_poses.csv", rows)


def set_rows(name: str, pose_set: PoseSet, rounds: int) -> list[Row]:
    """Every way on a set, in turn; the errors are those of the last round."""
    spent: dict[str, list[float]] = {OURS: [], INCREMENTAL: [], GLOBAL: []}
    found: dict[str, Reconstruction | None] = {}
    for _ in range(rounds):
        with tempfile.TemporaryDirectory() as folder:
            work = Path(folder)
            start = time.process_time()
            found[OURS] = our_poses(pose_set, work)
            spent[OURS].append(time.process_time() - start)
            start = time.process_time()
            database = match_by_defaults(pose_set, work)
            shared = time.process_time() - start
            for way, mapping in MAPPERS.items():
                start = time.process_time()
                models = mapping(database, pose_set.folder, work)
                spent[way].append(shared + time.process_time() - start)
                found[way] = largest(models, pose_set.frames)
    costs = costs_of({way: np.array(each) for way, each in spent.items()})
    return [
        {
            "set": name,
            "way": way,
            "frames with a pose": registered(found[way], pose_set.frames),
            "position, median or rms": errors["position"],
            "rotation, deg, median": errors["rotation"],
            "focal length, %": errors["focal"],
            "CPU s": f"{cost.cpu_s:.1f}",
            "CPU, of ours": f"{cost.of_first:.2f}",
        }
        for way, cost in costs.items()
        for errors in [describe(found[way], pose_set)]
    ]


def our_poses(pose_set: PoseSet, work: Path) -> Reconstruction:
    frames = pose_set.frames
    return reconstruct(
        pose_set.folder,
        frames.names,
        frames.indices,
        frames.times_s,
        workdir=work / "ours",
        ordered=frames.is_video,
    )


def match_by_defaults(pose_set: PoseSet, work: Path) -> Path:
    """Features and verified matches with pycolmap's defaults."""
    database = work / "peers.db"
    extraction, matching = pycolmap.FeatureExtractionOptions(), pycolmap.FeatureMatchingOptions()
    extraction.num_threads = matching.num_threads = 1
    pycolmap.extract_features(
        database,
        pose_set.folder,
        camera_mode=pycolmap.CameraMode.SINGLE,
        extraction_options=extraction,
    )
    match = pycolmap.match_sequential if pose_set.frames.is_video else pycolmap.match_exhaustive
    match(database, matching)
    return database


def map_incrementally(database: Path, images: Path, work: Path) -> Models:
    options = pycolmap.IncrementalPipelineOptions()
    options.num_threads = 1
    (work / "incremental").mkdir()
    return pycolmap.incremental_mapping(database, images, work / "incremental", options)


def map_globally(database: Path, images: Path, work: Path) -> Models:
    options = pycolmap.GlobalPipelineOptions()
    options.num_threads = 1
    (work / "global").mkdir()
    return pycolmap.global_mapping(database, images, work / "global", options)


MAPPERS = {INCREMENTAL: map_incrementally, GLOBAL: map_globally}


def largest(models: Models, frames: KeyFrames) -> Reconstruction | None:
    """The largest model, as ours; None where there is none."""
    if not models:
        return None
    model = max(models.values(), key=lambda one: one.num_reg_images())
    rows, ids = summary.rows_and_ids(model, frames.names)
    trajectory = summary.model_trajectory(model, ids, frames.indices[rows], frames.times_s[rows])
    return Reconstruction(
        trajectory=trajectory,
        names=tuple(frames.names[row] for row in rows),
        points_in_world=np.empty((0, 3)),
        point_errors_px=np.empty(0),
        visible=(),
        report={},
    )


def registered(found: Reconstruction | None, frames: KeyFrames) -> str:
    return f"{0 if found is None else len(found.names)} of {len(frames)}"


def describe(found: Reconstruction | None, pose_set: PoseSet) -> Mapping[str, str]:
    """Its errors, in words."""
    nothing = {"position": "-", "rotation": "-", "focal": "-"}
    if found is None:
        return nothing
    errors = pose_set.measure(found, pose_set.frames)
    if "path_rms_mm" in errors:
        position, focal = f"{errors['path_rms_mm']:.2f} mm", f"{errors['focal_percent']:+.2f}"
    else:
        position, focal = f"{1000 * errors['center_median']:.1f} mm", "-"
    rotation = f"{errors['rotation_median_deg']:.3f}"
    return nothing | {"position": position, "rotation": rotation, "focal": focal}
