"""What it costs to take one more view of a known plume into its estimate.

    python -m benchmarks.robot update --views 5000

A column of air is searched in 32 views of exact evidence, spoilt on purpose (see
`locate.simulation.evidence`), then followed through as many more as asked for, there and back
along the same arc. The time of an update is that of sighting the axis and of solving the graph.
"""

import argparse
import time
from itertools import cycle

import numpy as np

from locate.fusion.fuse import fuse
from locate.fusion.search.null import NullLevel
from locate.fusion.views import Views
from locate.messages.poses import StampedPose
from locate.messages.stamps import NS_PER_S
from locate.robot.drift import SharedError
from locate.robot.fixed_lag_smoother import FixedLagSmoother
from locate.simulation.evidence import (
    EvidenceFaults,
    make_faulty_views,
    orbit_trajectory,
    random_column,
)

KEPT = 32
NULL = NullLevel.from_draws([10.0, 14.0, 12.0])


def pose(views: Views, row: int, stamp_ns: int) -> StampedPose:
    matrix = np.eye(4)
    matrix[:3, :3] = views.trajectory.rotations[row].T
    matrix[:3, 3] = views.trajectory.centers_in_world[row]
    assert views.trajectory.covariances is not None
    return StampedPose(
        stamp_ns=stamp_ns, world_from_cam=matrix, covariance=views.trajectory.covariances[row]
    )


def one(views: Views, row: int) -> Views:
    return Views(
        trajectory=views.trajectory.take([row]),
        llr=views.llr[[row]],
        inverse_depth=views.inverse_depth[[row]],
        displacement=views.displacement[[row]],
        sigma_px=views.sigma_px[[row]],
        correlation_px2=views.correlation_px2,
    )


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--views", type=int, default=5000)
    parser.add_argument("--seed", type=int, default=5)


def main(options: argparse.Namespace) -> None:
    rng = np.random.default_rng(options.seed)
    truth = random_column(rng)
    views = make_faulty_views(
        truth, orbit_trajectory(KEPT, 60), rng, EvidenceFaults(missed_views=0)
    )
    started = time.process_time()
    (plume,) = fuse(views, null=NULL).plumes
    print(f"search of {KEPT} views: {time.process_time() - started:.1f} CPU s")
    poses = [pose(views, row, row * NS_PER_S // 5) for row in range(KEPT)]
    smoother = FixedLagSmoother(plume, views, poses, SharedError.from_poses([]), most=KEPT)
    rows = cycle([*reversed(range(KEPT)), *range(KEPT)])
    parts = [one(views, row) for row in range(KEPT)]
    spent_ms, latest = [], plume
    for number, row in zip(range(KEPT, KEPT + options.views), rows, strict=False):
        started = time.process_time()
        latest = (
            smoother.add_view(number, pose(views, row, number * NS_PER_S // 5), parts[row])
            or latest
        )
        spent_ms.append(1e3 * (time.process_time() - started))
    for name, part in (("first 500", spent_ms[:500]), ("last 500", spent_ms[-500:])):
        p50, p99 = np.percentile(part, [50, 99])
        print(f"update, {name}: p50 {p50:.1f} CPU ms, p99 {p99:.1f} ms")
    for name, found in (("search", plume), ("last update", latest)):
        error = found.source - truth.source
        squared = error @ np.linalg.solve(found.source_covariance, error)
        sigma_cm = 100 * found.principal_sigmas[0]
        print(f"{name}: sigma {sigma_cm:.1f} cm, Mahalanobis^2 to the truth {squared:.1f}")
