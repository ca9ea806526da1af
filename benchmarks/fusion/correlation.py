"""How many of a run's views say something of their own.

    python -m benchmarks.fusion correlation work/orbit/clean_1000/run work/orbit/clean_1003/run

The evidence of views k apart is correlated at the same points in space, sampled at random in the
run's volume; the strongest 5 % are clipped, so that a plume does not count as agreement. Of N views
``N / (1 + 2 sum(1 - k / N) r_k)`` count (Bartlett 1946). Once for points that float well before the
background, once for points close to a surface, where clutter lives.
"""

import argparse
from pathlib import Path

import numpy as np

from geometry.arrays import FloatArray, FloatMap
from geometry.grid import LEVER_FULL, LEVER_NONE, relative_lever
from geometry.trajectory import Trajectory
from locate.fusion.views import Views
from locate.pipeline.detections import load_detections

POINTS = 60_000
PLUME_PERCENT = 5
FEWEST_PAIRS = 500
FEWEST_VIEWS = 8
BANDS = {"floating": (LEVER_FULL, 1.0), "near a surface": (LEVER_NONE, LEVER_FULL / 2)}


def load_views(run: Path) -> Views:
    _, indices, detections = load_detections(run / "detections")
    trajectory = Trajectory.load(run / "trajectory.json")
    rows = np.searchsorted(trajectory.indices, np.asarray(indices))
    return Views.from_detections(detections, trajectory.take(rows))


def sample_views(views: Views, points: FloatArray) -> tuple[FloatMap, FloatMap]:
    """(V, N) evidence and lever of each point in each view; NaN where it is not in sight."""
    height, width = views.llr.shape[1:]
    llr = np.full((len(views), len(points)), np.nan, np.float32)
    levers = llr.copy()
    for i in range(len(views)):
        in_cam = views.trajectory.world_to_cam(i, points)
        pixel = np.rint(views.trajectory.camera.project(in_cam))
        seen = (in_cam[:, 2] > views.unit) & np.all((pixel >= 0) & (pixel < [width, height]), 1)
        x, y = pixel[seen].astype(int).T
        levers[i, seen] = relative_lever(
            in_cam[seen, 2].astype(np.float32), views.inverse_depth[i][y, x]
        )
        llr[i, seen] = views.llr[i][y, x]
    return llr, levers


def measure_correlations(llr: FloatMap) -> FloatArray:
    """Of views 1, 2, ... apart, up to half of them; 0 where too few points tell."""
    clipped = np.minimum(llr, np.nanpercentile(llr, 100 - PLUME_PERCENT))
    centred = clipped - np.nanmean(clipped)
    variance = np.nanmean(centred**2)
    found = np.zeros(len(llr) // 2)
    for k in range(1, len(found) + 1):
        products = centred[:-k] * centred[k:]
        if np.isfinite(products).sum() >= FEWEST_PAIRS:
            found[k - 1] = np.nanmean(products) / variance
    return found


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("runs", type=Path, nargs="+")


def main(options: argparse.Namespace) -> None:
    for run in options.runs:
        views = load_views(run)
        if len(views) < FEWEST_VIEWS or np.isnan(views.unit):
            print(f"{run.parent.name} | {FEWEST_VIEWS} views of known depth are needed")
            continue
        box = views.volume()
        size = np.array(box.shape[::-1]) * box.voxel
        points = box.low_in_world + np.random.default_rng(0).uniform(size=(POINTS, 3)) * size
        llr, levers = sample_views(views, points)
        for name, (low, high) in BANDS.items():
            r = np.maximum(
                measure_correlations(np.where((levers >= low) & (levers < high), llr, np.nan)), 0
            )
            steps = 1 - np.arange(1, len(r) + 1) / len(views)
            count = len(views) / (1 + 2 * float(steps @ r))
            print(
                f"{run.parent.name} | {name:14s} | {len(views)} views count as {count:.1f} | "
                f"correlation of neighbours {r[0]:.2f}, of views 4 apart {r[3]:.2f}",
                flush=True,
            )
