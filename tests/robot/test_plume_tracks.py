from dataclasses import replace

import gtsam
import numpy as np
import pytest

from locate.map.plume import Plume
from locate.messages.poses import PoseBuffer, StampedPose
from locate.messages.stamps import NS_PER_S
from locate.robot.drift import LEAST_OWN_SHARE, SharedError
from locate.robot.plume_tracks import (
    MOST_TRACKS,
    PlumeTracks,
    PlumeUpdate,
    TrackState,
    ViewSpan,
    combine_estimates,
    plume_column,
)
from tests.robot.test_next_view import plume

UNIT = 1.0


def at(x: float, *, views: tuple[int, ...] = (0, 1, 2), probability: float = 1.0) -> Plume:
    return replace(
        plume((0.1, 0.1, 0.1)),
        source=np.array([x, 0.0, 0.0]),
        views=views,
        probability=probability,
    )


def span(first: int, last: int) -> ViewSpan:
    return ViewSpan(first=first, last=last, stamp_ns=last * NS_PER_S)


def decide(
    tracks: PlumeTracks, found: list[Plume], views: ViewSpan, *, is_observed: bool = True
) -> list[PlumeUpdate]:
    return tracks.update(found, views, unit=UNIT, is_observed=lambda _plume: is_observed)


def test_ids_stay_with_their_plumes() -> None:
    tracks = PlumeTracks(independent=True)
    first = decide(tracks, [at(0.0), at(5.0)], span(0, 3))
    second = decide(tracks, [at(5.1), at(0.1), at(-5.0)], span(1, 4))
    assert [update.plume.id for update in first] == [1, 2]
    assert [(u.plume.id, float(u.plume.source[0])) for u in second] == [(2, 5.1), (1, 0.1), (3, -5)]


def test_candidate_is_confirmed_and_stays_so() -> None:
    tracks = PlumeTracks(independent=True)
    states = []
    for i, probability in enumerate([0.8, 0.999, 0.8]):
        states += decide(tracks, [at(0, probability=probability)], span(i, i + 3))
    expected = [TrackState.CANDIDATE, TrackState.CONFIRMED, TrackState.CONFIRMED]
    assert [update.state for update in states] == expected


def test_plume_is_lost_once_it_is_observed_and_not_found() -> None:
    tracks = PlumeTracks(independent=True)
    decide(tracks, [at(0)], span(0, 3))
    unseen = [decide(tracks, [], span(i, i + 3), is_observed=False) for i in range(9)]
    assert not any(unseen)
    lost = [decide(tracks, [], span(i, i + 3)) for i in range(9)]
    assert [update.state for updates in lost for update in updates] == [TrackState.LOST]
    (again,) = decide(tracks, [at(0)], span(20, 23))
    assert (again.plume.id, again.state) == (1, TrackState.CONFIRMED)


def test_views_count_once() -> None:
    tracks = PlumeTracks(independent=True)
    variances = []
    for i in range(30):
        (update,) = decide(tracks, [at(0, views=tuple(range(i, i + 10)))], span(i, i + 9))
        variances.append(update.plume.source_covariance[0, 0])
    assert variances[:10] == pytest.approx([0.01] * 10)
    assert variances[10:20] == pytest.approx([0.005] * 10)
    assert variances[-1] == pytest.approx(0.01 / 3)


def test_growing_window_replaces_its_estimate() -> None:
    tracks = PlumeTracks(independent=True)
    decide(tracks, [replace(at(0), source_covariance=1e-6 * np.eye(3))], span(0, 3))
    (update,) = decide(tracks, [at(0.1)], span(0, 7))
    assert update.plume.source_covariance[0, 0] == pytest.approx(0.01)


def test_drifting_poses_do_not_add_up() -> None:
    tracks = PlumeTracks(independent=False)
    for i in (0, 10, 20):
        (update,) = decide(tracks, [at(0, views=(i, i + 1))], span(i, i + 9))
    assert update.plume.source_covariance[0, 0] == pytest.approx(0.01, rel=1e-3)


def test_inconsistent_estimate_is_not_averaged() -> None:
    tracks = PlumeTracks(independent=True)
    sharp = replace(at(0.0), source_covariance=1e-4 * np.eye(3))
    moved = replace(sharp, source=np.array([0.3, 0.0, 0.0]), views=(10, 11))
    decide(tracks, [sharp], span(0, 9))
    (update,) = decide(tracks, [moved], span(10, 19))
    assert update.plume.source[0] == 0.3


def test_number_of_tracks_is_bounded() -> None:
    tracks = PlumeTracks(independent=True)
    decide(tracks, [at(0.0)], span(0, 3))
    for i in range(MOST_TRACKS + 20):
        decide(tracks, [at(10.0 * (i + 1), probability=0.8)], span(0, 3), is_observed=False)
    assert len(tracks.all_tracks) == MOST_TRACKS
    assert tracks.all_tracks[0].state is TrackState.CONFIRMED


def test_joined_estimates() -> None:
    a = np.zeros(3), np.diag([1.0, 4.0, 1.0])
    b = np.ones(3), np.diag([4.0, 1.0, 1.0])
    mean, covariance = combine_estimates(a, b, independent=True)
    np.testing.assert_allclose(np.diag(covariance), [0.8, 0.8, 0.5])
    np.testing.assert_allclose(mean, [0.2, 0.8, 0.5])
    _, careful = combine_estimates(a, b, independent=False)
    assert np.linalg.eigvalsh(careful - covariance).min() > 0
    assert np.trace(careful) <= min(np.trace(a[1]), np.trace(b[1])) + 1e-6


def test_plume_goes_back_to_its_column() -> None:
    column = plume_column(replace(plume(), axis=np.array([0.6, 0.0, 0.8]), extent_low=0.5))
    np.testing.assert_allclose(column.lowest_point, [0.3, 0.0, 0.4])
    np.testing.assert_allclose(column.slope, [0.75, 0.0])
    assert column.height == pytest.approx(1.5 * 0.8)


def pose(x: float, covariance: np.ndarray, stamp_ns: int = 0) -> StampedPose:
    matrix = np.eye(4)
    matrix[0, 3] = x
    return StampedPose(stamp_ns=stamp_ns, world_from_cam=matrix, covariance=covariance)


def test_shared_error_moves_points_as_a_wrong_world_would() -> None:
    covariance = np.diag([1e-4, 2e-4, 3e-4, 0.01, 0.02, 0.03])
    point = np.array([3.0, 1.0, 5.0])
    nominal = gtsam.Pose3(pose(1.0, covariance).world_from_cam)
    local = nominal.transformTo(point)
    draws = np.random.default_rng(0).multivariate_normal(np.zeros(6), covariance, 20_000)
    moved = np.array([nominal.retract(draw).transformFrom(local) for draw in draws])
    found = SharedError.from_poses([pose(1.0, covariance)]).covariance_at(point)
    np.testing.assert_allclose(
        found, (1 - LEAST_OWN_SHARE) * np.cov(moved.T), atol=0.05 * np.abs(found).max()
    )


def test_what_is_shared_is_taken_out_of_each_pose() -> None:
    start, step = np.diag([1e-6] * 3 + [0.01] * 3), np.diag([1e-8] * 3 + [0.002] * 3)
    poses = [pose(0.0, start), pose(0.0, start + step)]
    own = SharedError.from_poses(poses).remove_from(poses)
    np.testing.assert_allclose(own[0].covariance, LEAST_OWN_SHARE * start, rtol=1e-6)
    np.testing.assert_allclose(np.diag(own[1].covariance)[3:], 0.002, rtol=1e-6)


def test_unknown_covariances_share_nothing() -> None:
    unknown = pose(0.0, np.full((6, 6), np.nan))
    shared = SharedError.from_poses([unknown])
    assert np.isnan(shared.remove_from([unknown])[0].covariance).all()
    assert (shared.covariance_at(np.ones(3)) == 0).all()


def test_buffer_forgets_and_never_extrapolates() -> None:
    buffer = PoseBuffer(kept_ns=10 * NS_PER_S, max_gap_ns=NS_PER_S)
    zero = np.zeros((6, 6))
    for second in (5, 1, 3, 2, 4, 7):
        buffer.add(pose(float(second), zero, second * NS_PER_S))
    half = buffer.interpolate_at(5 * NS_PER_S // 2)
    assert half is not None
    assert half.center_in_world[0] == pytest.approx(2.5)
    assert buffer.interpolate_at(6 * NS_PER_S) is None
    assert buffer.interpolate_at(8 * NS_PER_S) is None
    assert buffer.interpolate_at(NS_PER_S // 2) is None
    buffer.add(pose(30.0, zero, 30 * NS_PER_S))
    buffer.add(pose(31.0, zero, 31 * NS_PER_S))
    assert len(buffer) == 2
