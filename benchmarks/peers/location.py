"""The source from the same detections: our fusion beside ways that locate by masks.

    OMP_NUM_THREADS=1 python -m benchmarks.peers location [--draws N] [--out DIR]
    OMP_NUM_THREADS=1 python -m benchmarks.peers location --run RUN TRUTH

Detections are the spoilt true masks of `benchmarks.fusion geometry` (16 views, range 8.5 m), and
half as many without a plume, in peers_location.csv; or those of a finished run of a simulated
recording, in peers_location_run.csv. A peer takes the largest blob of each view; ours has the
displacement and the depth of the background as well. Found is within 15 % of the range; anything
else that is stated is false. NEES/dof is 1 where a covariance is right.
"""

import argparse
from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

from benchmarks.common.csv_tables import DOCS, Row, write_table
from benchmarks.fusion.geometry import draw_views
from benchmarks.peers.blobs import Blobs, SourceEstimate
from benchmarks.peers.location_tally import Case, Tally
from benchmarks.peers.particle_filter import filter_particles
from benchmarks.peers.triangulation import triangulate_marks
from benchmarks.peers.visual_hull import carve
from detect.registry import DetectorChoice
from geometry.trajectory import Trajectory
from locate.evaluation.alignment import align_trajectories
from locate.evaluation.truth import SceneTruth
from locate.fusion.fuse import fuse
from locate.fusion.views import Views
from locate.pipeline.detections import load_detections
from locate.pipeline.files import RunFiles
from locate.simulation.evidence import RANGE_M, make_faulty_views, orbit_trajectory

FIRST = 6300
ARC_DEG, VIEWS = 60.0, 16
REGISTERED = DetectorChoice.parse("registered")
Way = Callable[[Views, float], SourceEstimate | None]


def by_fusion(views: Views, clutter_nats: float) -> SourceEstimate | None:
    """Ours: the strongest plume."""
    plumes = fuse(views, least_nats=clutter_nats * len(views)).plumes
    if not plumes:
        return None
    return SourceEstimate(source=plumes[0].source, covariance=plumes[0].source_covariance)


def by_centroids(views: Views, _: float) -> SourceEstimate | None:
    blobs = Blobs.of(views)
    return triangulate_marks(blobs.trajectory, blobs.centroids)


def by_lowest_points(views: Views, _: float) -> SourceEstimate | None:
    blobs = Blobs.of(views)
    return triangulate_marks(blobs.trajectory, blobs.lowest)


def by_carving(views: Views, _: float) -> SourceEstimate | None:
    return carve(Blobs.of(views), views.volume())


def by_particles(views: Views, _: float) -> SourceEstimate | None:
    blobs = Blobs.of(views)
    rng = np.random.default_rng(0)
    return filter_particles(blobs.trajectory, blobs.lowest, views.volume(), rng)


WAYS: dict[str, Way] = {
    "ours: fusion": by_fusion,
    "mask centroids, triangulated": by_centroids,
    "lowest mask points, triangulated": by_lowest_points,
    "space carving": by_carving,
    "particle filter": by_particles,
}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--draws", type=int, default=20)
    parser.add_argument("--run", type=Path, nargs=2, metavar=("RUN", "TRUTH"), help="two folders")
    parser.add_argument("--out", type=Path, default=DOCS)


def main(options: argparse.Namespace) -> None:
    if options.run is None:
        write_table(options.out / "peers_location.csv", compare(drawn_cases(options.draws), 0.0))
    else:
        rows = compare([case_of_run(*options.run)], REGISTERED.clutter_nats)
        write_table(options.out / "peers_location_run.csv", rows)


def drawn_cases(draws: int) -> Iterator[Case]:
    """Half as many without a plume."""
    for seed in range(FIRST, FIRST + draws):
        truth, views = draw_views(seed, ARC_DEG, VIEWS)
        yield Case(views=views, source=truth.source, range_m=RANGE_M)
    for seed in range(FIRST, FIRST + draws // 2):
        rng = np.random.default_rng([seed, 1])
        views = make_faulty_views(None, orbit_trajectory(VIEWS, ARC_DEG), rng)
        yield Case(views=views, source=None, range_m=RANGE_M)


def case_of_run(run: Path, truth: Path) -> Case:
    """The detections of a run, and the true source in the world of its map."""
    files, scene = RunFiles(run), SceneTruth.load(truth)
    trajectory = Trajectory.load(files.trajectory)
    _, indices, found = load_detections(files.detections)
    pinhole = replace(trajectory, camera=trajectory.camera.undistorted())
    poses = pinhole.take(np.searchsorted(trajectory.indices, indices))
    map_from_truth = align_trajectories(trajectory, scene.trajectory).truth_from_map.inverse()
    (source,) = map_from_truth(scene.sources[:1])
    range_m = float(np.linalg.norm(poses.centers_in_world - source, axis=1).mean())
    return Case(views=Views.from_detections(found, poses), source=source, range_m=range_m)


def compare(cases: Iterable[Case], clutter_nats: float) -> list[Row]:
    """Every way on every case, in turn."""
    tallies = {name: Tally() for name in WAYS}
    for case in cases:
        for name, way in WAYS.items():
            tallies[name].add(case, partial(way, case.views, clutter_nats))
    ours = next(iter(tallies.values()))
    return [tally.row(name, ours) for name, tally in tallies.items()]
