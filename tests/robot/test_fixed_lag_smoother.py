from dataclasses import replace

import numpy as np
import pytest

from locate.fusion.fuse import fuse
from locate.fusion.search.null import NullLevel
from locate.fusion.views import Views
from locate.map.plume import Plume
from locate.messages.poses import StampedPose
from locate.messages.stamps import NS_PER_S
from locate.robot.drift import SharedError
from locate.robot.fixed_lag_smoother import FixedLagSmoother
from locate.simulation.evidence import ColumnTruth

KEPT = 8


def row(views: Views, i: int) -> Views:
    return Views(
        trajectory=views.trajectory.take([i]),
        llr=views.llr[[i]],
        inverse_depth=views.inverse_depth[[i]],
        displacement=views.displacement[[i]],
        sigma_px=views.sigma_px[[i]],
        correlation_px2=views.correlation_px2,
    )


def first(views: Views, count: int) -> Views:
    return Views(
        trajectory=views.trajectory.take(range(count)),
        llr=views.llr[:count],
        inverse_depth=views.inverse_depth[:count],
        displacement=views.displacement[:count],
        sigma_px=views.sigma_px[:count],
        correlation_px2=views.correlation_px2,
    )


def pose(views: Views, i: int) -> StampedPose:
    matrix = np.eye(4)
    matrix[:3, :3] = views.trajectory.rotations[i].T
    matrix[:3, 3] = views.trajectory.centers_in_world[i]
    assert views.trajectory.covariances is not None
    return StampedPose(
        stamp_ns=i * NS_PER_S // 5,
        world_from_cam=matrix,
        covariance=views.trajectory.covariances[i],
    )


@pytest.fixture(scope="module")
def found(views: Views) -> Plume:
    (plume,) = fuse(first(views, KEPT), null=NullLevel.from_draws([8.0, 9.0, 10.0])).plumes
    return plume


def begun(views: Views, plume: Plume, *, most: int = 32) -> FixedLagSmoother:
    poses = [pose(views, i) for i in range(KEPT)]
    return FixedLagSmoother(plume, first(views, KEPT), poses, SharedError.from_poses([]), most=most)


def test_more_views_make_the_axis_more_certain(
    views: Views, truth: ColumnTruth, found: Plume
) -> None:
    smoother = begun(views, found)
    latest = found
    for i in range(KEPT, len(views)):
        latest = smoother.add_view(i, pose(views, i), row(views, i)) or latest
    assert smoother.view_range == (0, len(views) - 1)
    assert latest.axis_sigma_rad < found.axis_sigma_rad
    assert set(latest.views) > set(found.views)
    error = latest.source - truth.source
    assert error @ np.linalg.solve(latest.source_covariance, error) < 16


def test_view_without_evidence_changes_nothing(views: Views, found: Plume) -> None:
    smoother = begun(views, found)
    silent = replace(row(views, 9), llr=np.full_like(views.llr[[9]], -0.5))
    assert smoother.add_view(9, pose(views, 9), silent) is None
    assert smoother.view_range == (0, KEPT - 1)


def test_number_of_views_is_bounded(views: Views, found: Plume) -> None:
    smoother = begun(views, found, most=KEPT)
    for i in range(KEPT, len(views)):
        smoother.add_view(i, pose(views, i), row(views, i))
    assert len(smoother._measurements) == KEPT
    assert smoother.view_range[0] > 0
