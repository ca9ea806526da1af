"""The error of a source beside the bound of the rays that see it.

    python -m benchmarks.bounds source [--draws N] [--out DIR]

Writes bounds_source.csv. Views are those of `benchmarks.fusion geometry`: 16 on an arc of 60
degrees, 8.5 m away, exact displacement. The bound is that of the source's pixel in every view that
shows it, known to within the pixel, through poses with the errors that the views have. Below the
line with all faults each kind of them is left out.
"""

import argparse
from dataclasses import replace
from pathlib import Path

import numpy as np

from benchmarks.common.csv_tables import DOCS, Row, write_table
from benchmarks.peers.blobs import Blobs
from benchmarks.peers.triangulation import triangulate_marks
from geometry.arrays import FloatArray
from geometry.trajectory import Trajectory
from locate.fusion.fuse import fuse
from locate.fusion.search.null import NullLevel
from locate.fusion.views import Views
from locate.simulation.evidence import (
    NO_FAULTS,
    ColumnTruth,
    EvidenceFaults,
    make_faulty_views,
    orbit_trajectory,
    random_column,
)

FIRST = 6300
ARC_DEG, VIEWS = 60.0, 16
PIXEL_VARIANCE = 1 / 12
BOUND_DRAWS = 4000
NULL = NullLevel.from_draws([10.0, 14.0, 12.0])
"""Plumes are far stronger than chance here; drawing it anew would change no position."""
ALL = EvidenceFaults()
FAULTS = {
    "all faults": ALL,
    "exact poses": replace(ALL, position_sigma_m=0, rotation_sigma_deg=0),
    "exact masks": replace(NO_FAULTS, position_sigma_m=0.01, rotation_sigma_deg=0.1),
    "neither": NO_FAULTS,
}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--draws", type=int, default=12)
    parser.add_argument("--out", type=Path, default=DOCS)


def main(options: argparse.Namespace) -> None:
    rows = [fault_row(name, faults, options.draws) for name, faults in FAULTS.items()]
    write_table(options.out / "bounds_source.csv", rows)


def fault_row(name: str, faults: EvidenceFaults, draws: int) -> Row:
    """Median errors, of our fusion and of the triangulated lowest points, and the median bound."""
    bounds, ours, marks = np.empty((3, draws))
    for k in range(draws):
        truth, views = draw(FIRST + k, faults)
        bounds[k] = median_length(source_bound(views, truth, faults))
        ours[k] = error_of_fusion(views, truth)
        blobs = Blobs.of(views)
        found = triangulate_marks(blobs.trajectory, blobs.lowest)
        marks[k] = np.inf if found is None else np.linalg.norm(found.source - truth.source)
    bound, error, other = np.median([bounds, ours, marks], axis=1)
    return {
        "views": name,
        "bound, m": f"{bound:.4f}",
        "ours, m": f"{error:.4f}",
        "ours, of the bound": f"{error / bound:.1f}",
        "lowest mask points, m": f"{other:.4f}",
        "lowest mask points, of the bound": f"{other / bound:.1f}",
    }


def draw(seed: int, faults: EvidenceFaults) -> tuple[ColumnTruth, Views]:
    rng = np.random.default_rng(seed)
    truth = random_column(rng)
    return truth, make_faulty_views(truth, orbit_trajectory(VIEWS, ARC_DEG), rng, faults)


def error_of_fusion(views: Views, truth: ColumnTruth) -> float:
    errors = [float(np.linalg.norm(p.source - truth.source)) for p in fuse(views, null=NULL).plumes]
    return min(errors, default=np.inf)


def source_bound(views: Views, truth: ColumnTruth, faults: EvidenceFaults) -> FloatArray:
    """(3, 3) covariance that no unbiased estimate of the source goes below."""
    information = np.zeros((3, 3))
    turn = np.deg2rad(faults.rotation_sigma_deg)
    for i in np.flatnonzero(views.displacement.any(axis=(1, 2, 3))):
        by_point, by_turn = pixel_slopes(views.trajectory, int(i), truth.source)
        covariance = PIXEL_VARIANCE * np.eye(2)
        covariance += turn**2 * by_turn @ by_turn.T
        covariance += faults.position_sigma_m**2 * by_point @ by_point.T
        information += by_point.T @ np.linalg.solve(covariance, by_point)
    return np.asarray(np.linalg.inv(information), dtype=float)


def pixel_slopes(
    trajectory: Trajectory, i: int, point: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """(2, 3) slope of a point's pixel by the point, and (2, 3) by a turn of the camera."""
    x, y, z = trajectory.world_to_cam(i, point)
    by_cam = trajectory.camera.focal_px / z * np.array([[1, 0, -x / z], [0, 1, -y / z]])
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return by_cam @ trajectory.rotations[i], by_cam @ -cross


def median_length(covariance: FloatArray) -> float:
    """Median length of errors with that covariance."""
    rng = np.random.default_rng(0)
    errors = rng.multivariate_normal(np.zeros(3), covariance, BOUND_DRAWS)
    return float(np.median(np.linalg.norm(errors, axis=1)))
