"""The source from the same detections: our fusion beside ways that locate by masks.

    OMP_NUM_THREADS=1 python -m benchmarks.peers location [--draws N] [--filmed DIR] [--out DIR]

Detections are the spoilt true masks of `benchmarks.fusion geometry` (16 views, range 8.5 m; without
a plume for the false ones), in peers_location.csv; and with `--filmed` those of `registered` in
recordings that `benchmarks.reliability film` left there, in peers_location_filmed.csv. A peer takes
the largest blob of each view; ours has the displacement and the depth of the background as well.
Found is within 15 % of the range; anything else that is stated is false. NEES/dof is 1 where a
covariance is right.
"""

import argparse
from collections.abc import Callable, Iterable, Iterator
from functools import partial
from pathlib import Path

import numpy as np

from benchmarks.common.csv_tables import DOCS, Row, write_table
from benchmarks.common.evidence import RANGE_M, make_faulty_views, orbit_trajectory
from benchmarks.common.filmed import Recorded
from benchmarks.fusion.geometry import draw_views
from benchmarks.peers.blobs import Blobs, SourceEstimate
from benchmarks.peers.location_tally import Case, Tally
from benchmarks.peers.particle_filter import filter_particles
from benchmarks.peers.triangulation import triangulate_marks
from benchmarks.peers.visual_hull import carve
from benchmarks.reliability.recordings import scene_of
from detect.registry import DetectorChoice
from locate.fusion.fuse import fuse
from locate.fusion.views import Views
from locate.simulation.capture import CaptureSetup

FIRST = 6300
ARC_DEG, VIEWS = 60.0, 16
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
    parser.add_argument("--filmed", type=Path, help="work folder of benchmarks.reliability")
    parser.add_argument("--out", type=Path, default=DOCS)


def main(options: argparse.Namespace) -> None:
    if options.filmed is None:
        write_table(options.out / "peers_location.csv", compare(drawn_cases(options.draws), 0.0))
    else:
        cases = filmed_cases(options.filmed)
        rows = compare(cases, DetectorChoice.parse("registered").clutter_nats)
        write_table(options.out / "peers_location_filmed.csv", rows)


def drawn_cases(draws: int) -> Iterator[Case]:
    """Half as many without a plume."""
    for seed in range(FIRST, FIRST + draws):
        truth, views = draw_views(seed, ARC_DEG, VIEWS)
        yield Case(views=views, source=truth.source, range_m=RANGE_M)
    for seed in range(FIRST, FIRST + draws // 2):
        rng = np.random.default_rng([seed, 1])
        views = make_faulty_views(None, orbit_trajectory(VIEWS, ARC_DEG), rng)
        yield Case(views=views, source=None, range_m=RANGE_M)


def filmed_cases(folder: Path) -> Iterator[Case]:
    """Lossless recordings of plants, as they are there."""
    detector = DetectorChoice.parse("registered").make()
    for path in sorted(folder.glob("*.npz")):
        scene = scene_of(int(path.stem))
        sequence = Recorded.load(path, CaptureSetup(scene=scene))
        units = sequence.inverse_depth_units.tolist()
        found = [
            detector.to_detection(*each) for each in zip(sequence.measurements, units, strict=True)
        ]
        views = Views.from_detections(found, sequence.trajectory)
        source = np.array(scene.plumes[0].source) if scene.plumes else None
        target = np.array(scene.path.target) if source is None else source
        away = np.linalg.norm(sequence.trajectory.centers_in_world - target, axis=1)
        yield Case(views=views, source=source, range_m=float(away.mean()))


def compare(cases: Iterable[Case], clutter_nats: float) -> list[Row]:
    """Every way on every case, in turn."""
    tallies = {name: Tally() for name in WAYS}
    for case in cases:
        for name, way in WAYS.items():
            tallies[name].add(case, partial(way, case.views, clutter_nats))
    ours = next(iter(tallies.values()))
    return [tally.row(name, ours) for name, tally in tallies.items()]
