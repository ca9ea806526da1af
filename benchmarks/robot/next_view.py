"""Views needed until a source is known to 5 cm: the suggested ones against a lawn-mower's.

    python -m benchmarks.robot next-view --scenes 20

Exact evidence, spoilt on purpose (see `locate.simulation.evidence`). Every robot begins with the
same eight views on a short arc. Then one takes, of a grid of places, the one that `suggest` ranks
first; the others take the same places lane by lane, one with the camera fixed, one turning it to
the plume. As in a `Locator`, all views are searched where enough are new, and the plume is followed
in between. What chance makes is taken as known (`NULL`), for speed: it does not enter the sigma.
"""

import argparse
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from geometry.arrays import FloatArray
from geometry.trajectory import Trajectory
from locate.fusion.fuse import fuse
from locate.fusion.search.null import NullLevel
from locate.fusion.views import Views
from locate.map.plume import Plume
from locate.messages.poses import StampedPose
from locate.messages.stamps import NS_PER_S
from locate.robot.drift import SharedError
from locate.robot.engine import NEW_SHARE
from locate.robot.fixed_lag_smoother import FixedLagSmoother
from locate.robot.next_view import rank_poses
from locate.robot.settings import LocatorSettings
from locate.simulation.camera_paths import look_at
from locate.simulation.evidence import (
    ColumnTruth,
    EvidenceFaults,
    make_faulty_views,
    orbit_trajectory,
    random_column,
)

GOAL_M = 0.05
FIRST_VIEWS, MOST_VIEWS = 8, 40
VIEWS_A_SECOND = 5
LANES_X, LANES_Y = np.linspace(-8, 8, 9), np.linspace(-9, 3, 5)
HEIGHT_M = 2.0
AHEAD, ABOVE = np.array([0.0, 1.0, -0.1]), np.array([0.0, 0.0, 0.8])
NULL = NullLevel.from_draws([10.0, 14.0, 12.0])


def places() -> list[FloatArray]:
    """Camera centres, lane by lane, there and back."""
    return [
        np.array([x, y, HEIGHT_M])
        for lane, y in enumerate(LANES_Y)
        for x in (LANES_X if lane % 2 == 0 else LANES_X[::-1])
    ]


def pose_towards(center: FloatArray, target: FloatArray) -> FloatArray:
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = look_at(center, target).T, center
    return pose


def trajectory(poses: Sequence[FloatArray], first: Trajectory) -> Trajectory:
    rotations = np.array([pose[:3, :3].T for pose in poses])
    centers = np.array([pose[:3, 3] for pose in poses])
    return replace(
        first,
        indices=np.arange(len(poses)),
        times_s=np.arange(len(poses)) / VIEWS_A_SECOND,
        rotations=rotations,
        translations=-np.einsum("nij,nj->ni", rotations, centers),
        covariances=None,
    )


def join_views(parts: Sequence[Views]) -> Views:
    whole = trajectory(
        [_world_from_cam(part.trajectory, i) for part in parts for i in range(len(part))],
        parts[0].trajectory,
    )
    covariances = np.concatenate([part.trajectory.covariances for part in parts])
    return Views(
        trajectory=replace(whole, covariances=covariances),
        llr=np.concatenate([part.llr for part in parts]),
        inverse_depth=np.concatenate([part.inverse_depth for part in parts]),
        displacement=np.concatenate([part.displacement for part in parts]),
        sigma_px=np.concatenate([part.sigma_px for part in parts]),
        correlation_px2=parts[0].correlation_px2,
    )


def _world_from_cam(trajectory: Trajectory, i: int) -> FloatArray:
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = trajectory.rotations[i].T, trajectory.centers_in_world[i]
    return pose


class KnownPlume:
    """What a robot knows of the plume."""

    def __init__(self, first: Views) -> None:
        self.parts = [first]
        self.plume: Plume | None = None
        self._smoother: FixedLagSmoother | None = None
        self._searched = 0

    @property
    def views(self) -> Views:
        return join_views(self.parts)

    def add(self, view: Views) -> None:
        number = sum(map(len, self.parts))
        self.parts.append(view)
        if self._smoother is not None:
            self.plume = (
                self._smoother.add_view(number, poses_of(view, number)[0], view) or self.plume
            )

    def search(self) -> None:
        """Looks through all views if enough are new."""
        views = self.views
        if len(views) - self._searched < max(
            LocatorSettings().views_a_decision, NEW_SHARE * len(views)
        ):
            return
        self._searched = len(views)
        self.plume, self._smoother = next(iter(fuse(views, null=NULL).plumes), None), None
        if self.plume is not None:
            nothing_shared = SharedError(pose=None)
            self._smoother = FixedLagSmoother(
                self.plume, views, poses_of(views), nothing_shared, most=MOST_VIEWS
            )


def poses_of(views: Views, first: int = 0) -> list[StampedPose]:
    covariances = views.trajectory.covariances
    assert covariances is not None
    return [
        StampedPose(
            stamp_ns=(first + i) * NS_PER_S // VIEWS_A_SECOND,
            world_from_cam=_world_from_cam(views.trajectory, i),
            covariance=covariances[i],
        )
        for i in range(len(views))
    ]


class Turning:
    """The lawn-mower's places, the camera turned to the plume."""

    def __init__(self) -> None:
        self._left = places()

    def next(self, _views: Views, target: FloatArray, _plume: Plume | None) -> FloatArray:
        return pose_towards(self._left.pop(0), target)


class Fixed(Turning):
    """The lawn-mower: the camera looks the same way all the time."""

    def next(self, _views: Views, _target: FloatArray, _plume: Plume | None) -> FloatArray:
        center = self._left.pop(0)
        return pose_towards(center, center + AHEAD)


class Suggested(Turning):
    """Of the places left, the one that is ranked first."""

    def next(self, views: Views, target: FloatArray, plume: Plume | None) -> FloatArray:
        if plume is None:
            return super().next(views, target, plume)
        poses = [pose_towards(center, target) for center in self._left]
        background = views.background_in_world(16)
        best = rank_poses([plume], background, views.trajectory.camera, poses)[0].index
        return pose_towards(self._left.pop(best), target)


POLICIES = {"suggested": Suggested, "turning": Turning, "fixed": Fixed}


def error_in_sigmas(plume: Plume, truth: ColumnTruth) -> float:
    error = plume.source - truth.source
    return float(np.sqrt(error @ np.linalg.solve(plume.source_covariance, error)))


def views_needed(policy: Turning, seed: int) -> tuple[int, float]:
    """How many views until the largest sigma is below the goal, and the error then in sigmas."""
    rng = np.random.default_rng(seed)
    truth = random_column(rng)
    faults = EvidenceFaults()
    first = make_faulty_views(truth, orbit_trajectory(FIRST_VIEWS, 15), rng, faults)
    known = KnownPlume(first)
    target = np.array([0.0, 0.0, 1.0])
    for count in range(FIRST_VIEWS, MOST_VIEWS):
        known.search()
        if known.plume is not None:
            target = known.plume.source + ABOVE
            if known.plume.principal_sigmas[0] < GOAL_M:
                return count, error_in_sigmas(known.plume, truth)
        pose = policy.next(known.views, target, known.plume)
        where = trajectory([pose], first.trajectory)
        with np.errstate(invalid="ignore"):  # a plume behind the camera has no pixels
            known.add(make_faulty_views(truth, where, rng, faults))
    return MOST_VIEWS, np.nan


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--scenes", type=int, default=20)
    parser.add_argument("--first", type=int, default=0, help="seed of the first scene")


def main(options: argparse.Namespace) -> None:
    needed: dict[str, list[int]] = {name: [] for name in POLICIES}
    for seed in range(options.first, options.first + options.scenes):
        line = [f"{seed:2d}"]
        for name, policy in POLICIES.items():
            count, error = views_needed(policy(), seed)
            needed[name].append(count)
            line.append(f"{name} {count} views, error {error:.1f} sigma")
        print(" | ".join(line), flush=True)
    for name, counts in needed.items():
        missed = sum(count == MOST_VIEWS for count in counts)
        print(f"{name}: median {np.median(counts):.0f} views, not reached in {missed}")
