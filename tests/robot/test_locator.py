import itertools
import threading
from dataclasses import replace

import numpy as np
import pytest

from detect.detection import Detection, Frames
from geometry.camera import Camera
from geometry.errors import BadInputError
from locate.fusion.fuse import fuse
from locate.fusion.search.null import NullLevel
from locate.fusion.views import Views
from locate.messages.poses import UNKNOWN_COVARIANCE, StampedPose
from locate.messages.stamps import NS_PER_S
from locate.robot import Locator, LocatorSettings, PlumeUpdate, TrackState
from locate.robot.engine import PlumeEngine
from locate.robot.search import LocalPlumeSearch
from locate.robot.window import FrameWindow, WindowFrame
from locate.simulation.evidence import ColumnTruth
from tests.robot.drive import BLANK, Oracle, moments

QUICK = LocatorSettings(lag=2, views_kept=16, null_draws=2, drift=False)
UNDECIDED = replace(QUICK, views_a_decision=1000, lag=0)


def inline(views: Views, settings: LocatorSettings = QUICK) -> Locator:
    return Locator(
        views.trajectory.camera, settings=settings, detector=Oracle(views), threaded=False
    )


def drive(locator: Locator, views: Views) -> list[PlumeUpdate]:
    updates = []
    for moment in moments(views):
        updates += locator.feed(
            moment.image, moment.world_from_cam, moment.covariance, moment.stamp_ns
        )
    return updates + locator.finish()


@pytest.fixture(scope="module")
def driven(views: Views) -> tuple[Locator, list[PlumeUpdate]]:
    locator = inline(views)
    return locator, drive(locator, views)


def test_plume_is_confirmed_before_the_drive_ends(
    driven: tuple[Locator, list[PlumeUpdate]], truth: ColumnTruth
) -> None:
    locator, updates = driven
    first = next(update for update in updates if update.state is TrackState.CONFIRMED)
    assert first.stamp_ns < 100 * NS_PER_S + 11 * NS_PER_S // 5
    assert {update.plume.id for update in updates if update.state is TrackState.CONFIRMED} == {1}
    (plume,) = locator.plume_map().plumes
    error = plume.source - truth.source
    assert error @ np.linalg.solve(plume.source_covariance, error) < 16


def test_plume_is_that_of_an_offline_run_with_the_same_random_draws(
    driven: tuple[Locator, list[PlumeUpdate]], views: Views
) -> None:
    (online,) = driven[0].plume_map().plumes
    (offline,) = fuse(views, seed=QUICK.seed, null=NullLevel.from_draws([8.0, 9.0, 10.0])).plumes
    np.testing.assert_allclose(online.source, offline.source, atol=1e-3)
    np.testing.assert_allclose(online.source_covariance, offline.source_covariance, rtol=0.02)
    assert online.views == offline.views


@pytest.mark.parametrize("order", ["late", "early", "shuffled"])
def test_poses_may_come_in_any_order(
    driven: tuple[Locator, list[PlumeUpdate]], views: Views, order: str
) -> None:
    locator = inline(views, UNDECIDED)
    poses = list(moments(views))
    images = list(poses)
    if order == "shuffled":
        np.random.default_rng(0).shuffle(poses)
    pose_delay = {"late": 3, "early": -3, "shuffled": 0}[order]
    events = [(i + pose_delay, 0, i) for i in range(12)] + [(i, 1, i) for i in range(12)]
    for _, is_image, i in sorted(events):
        if is_image:
            locator.feed_image(images[i].image, images[i].stamp_ns)
        else:
            moment = poses[i]
            locator.feed_pose(moment.world_from_cam, moment.covariance, moment.stamp_ns)
    locator.finish()
    assert locator.counts.looked_at + locator.counts.unposed == 12
    assert locator.counts.looked_at >= (8 if order == "shuffled" else 12)
    (plume,), (usual,) = locator.plume_map().plumes, driven[0].plume_map().plumes
    np.testing.assert_allclose(plume.source, usual.source, atol=0.05)


def test_images_between_poses_get_the_pose_between(views: Views) -> None:
    locator = inline(views, UNDECIDED)
    every = list(moments(views))
    for moment in every:
        locator.feed_pose(moment.world_from_cam, None, moment.stamp_ns)
    for before, after in itertools.pairwise(every):
        locator.feed_image(BLANK, (before.stamp_ns + after.stamp_ns) // 2)
    assert locator.counts.key_frames == 11
    assert locator.counts.unposed == 0


def test_pose_stream_that_stops_costs_images_and_nothing_else(views: Views) -> None:
    locator = inline(views, replace(UNDECIDED, patience_s=0.5, images_kept=4))
    every = list(moments(views))
    for i, moment in enumerate(every):
        if not 4 <= i < 9:
            locator.feed_pose(moment.world_from_cam, None, moment.stamp_ns)
        locator.feed_image(BLANK, moment.stamp_ns)
    assert locator.counts.unposed == 5
    assert locator.counts.looked_at == 7


def test_no_plume_is_reported_where_there_is_none(views: Views) -> None:
    blind = replace(views, llr=np.where(views.llr > 0, np.float32(-0.5), views.llr))
    locator = inline(blind)
    updates = drive(locator, blind)
    assert all(update.state is not TrackState.CONFIRMED for update in updates)
    assert locator.plume_map().plumes == ()


@pytest.mark.parametrize("plume", [False, True])
def test_chance_is_drawn_only_for_what_stands_above_a_networks_clutter(
    views: Views, monkeypatch: pytest.MonkeyPatch, *, plume: bool
) -> None:
    draws: list[float] = []

    def drawn(*_how: object) -> float:
        draws.append(10.0 + len(draws))
        return draws[-1]

    monkeypatch.setattr("locate.robot.search.draw_strongest", drawn)
    shown = views if plume else replace(views, llr=np.full_like(views.llr, -0.5))
    learned = Oracle(shown)
    learned.name = "registered"
    settings = replace(QUICK, views_a_decision=1000)
    locator = Locator(views.trajectory.camera, settings=settings, detector=learned, threaded=False)
    drive(locator, shown)
    assert len(draws) == plume * settings.null_draws
    assert len(locator.plume_map().plumes) == plume


def test_plume_that_stops_is_lost(views: Views) -> None:
    settings = replace(QUICK, views_kept=8)
    locator = inline(views, settings)
    drive(locator, views)
    silent = np.full_like(views.llr, -0.5)
    states: list[TrackState] = []
    oracle = locator._detector
    assert isinstance(oracle, Oracle)
    oracle.views = replace(views, llr=silent)
    for turn in range(1, 4):
        for moment in moments(views, start_ns=(100 + 5 * turn) * NS_PER_S):
            updates = locator.feed(BLANK, moment.world_from_cam, None, moment.stamp_ns)
            states += [update.state for update in updates if update.plume.id == 1]
    assert states[-1] is TrackState.LOST
    assert states.count(TrackState.LOST) == 1
    assert locator.plume_map().plumes == ()


def test_standing_still_adds_nothing(views: Views) -> None:
    locator = inline(views, UNDECIDED)
    moment = next(moments(views))
    for i in range(50):
        locator.feed(BLANK, moment.world_from_cam, None, moment.stamp_ns + i * NS_PER_S // 30)
    assert locator.counts.key_frames == 1
    assert locator.counts.passed_over == 49


def test_jump_of_the_world_begins_a_new_window(views: Views) -> None:
    locator = inline(views, UNDECIDED)
    for i, moment in enumerate(moments(views)):
        pose = moment.world_from_cam.copy()
        pose[0, 3] += 50.0 * (i >= 6)
        locator.feed(BLANK, pose, None, moment.stamp_ns)
    assert locator.counts.jumps == 1
    assert len(locator._selector.window) == 6


def test_frame_of_a_window_that_has_ended_is_not_kept(views: Views) -> None:
    camera = views.trajectory.camera
    engine = PlumeEngine(LocalPlumeSearch("oracle", QUICK), QUICK)
    stamped = [
        StampedPose(
            stamp_ns=m.stamp_ns, world_from_cam=m.world_from_cam, covariance=UNKNOWN_COVARIANCE
        )
        for m in moments(views)
    ]
    tasks = []
    for first in (0, 6):
        window = FrameWindow(camera, first=first, most=6, lag=0)
        for number in range(first, first + 6):
            window.add(WindowFrame(number=number, image=BLANK, pose=stamped[number]))
        tasks += [window.take_task(newest=False), window.take_task(newest=False)]
    detector = Oracle(views)
    for turn in (0, 2, 1, 3):
        task = tasks[turn]
        assert task is not None
        engine.process_frame(task, detector)
    assert engine._evidence.numbers == [6, 7]


def test_clock_that_goes_back_begins_anew(views: Views) -> None:
    locator = inline(views, UNDECIDED)
    drive(locator, views)
    for moment in moments(views, start_ns=NS_PER_S):
        locator.feed(BLANK, moment.world_from_cam, None, moment.stamp_ns)
    assert locator.counts.jumps == 1
    assert locator.counts.key_frames == 24
    assert len(locator.plume_map().plumes) == 1


def test_another_camera_keeps_the_plumes(views: Views) -> None:
    locator = inline(views, UNDECIDED)
    drive(locator, views)
    locator.set_camera(Camera.pinhole(160, 120, 140.0))
    for moment in moments(views, start_ns=200 * NS_PER_S):
        image = np.zeros((120, 160), np.uint8)
        locator.feed(image, moment.world_from_cam, None, moment.stamp_ns)
    assert locator.counts.failures == 0
    assert len(locator.plume_map().plumes) == 1


class Held(Oracle):
    """Measures nothing before it is released."""

    def __init__(self, views: Views) -> None:
        super().__init__(views)
        self.released = threading.Event()

    def detect(self, frames: Frames, index: int) -> Detection:
        assert self.released.wait(60), "whoever feeds waited for the detector"
        return super().detect(frames, index)


def test_slow_detector_drops_the_oldest_and_never_blocks(views: Views) -> None:
    settings = replace(QUICK, frames_kept=4, lag=1, views_a_decision=100)
    before, detector = set(threading.enumerate()), Held(views)
    with Locator(views.trajectory.camera, settings=settings, detector=detector) as locator:
        for moment in moments(views):
            locator.feed(BLANK, moment.world_from_cam, None, moment.stamp_ns)
        detector.released.set()
        locator.finish()
        counts = locator.counts
        assert counts.dropped > 0
        assert counts.dropped + counts.looked_at == counts.key_frames == 12
        assert 11 in detector.seen
    assert set(threading.enumerate()) <= before


class Broken(Oracle):
    def detect(self, frames: Frames, index: int) -> Detection:
        if index % 2:
            raise RuntimeError("out of order")
        return super().detect(frames, index)


def test_failing_detector_is_counted_and_survived(
    views: Views, caplog: pytest.LogCaptureFixture
) -> None:
    with Locator(views.trajectory.camera, settings=UNDECIDED, detector=Broken(views)) as locator:
        drive(locator, views)
    assert 0 < locator.counts.failures < locator.counts.looked_at == 12
    assert "out of order" in caplog.text


def test_reset_forgets_everything(views: Views) -> None:
    locator = inline(views, UNDECIDED)
    drive(locator, views)
    locator.reset()
    assert locator.plume_map().plumes == ()
    assert locator.counts.images == 0
    locator.feed(BLANK, np.eye(4), None, NS_PER_S)
    assert locator.counts.looked_at == 1


@pytest.mark.parametrize(
    ("image", "pose", "covariance"),
    [
        (np.zeros((10, 10), np.uint8), np.eye(4), None),
        (BLANK.astype(np.float32), np.eye(4), None),
        (BLANK, np.eye(3), None),
        (BLANK, np.full((4, 4), np.nan), None),
        (BLANK, 2 * np.eye(4), None),
        (BLANK, np.diag([1.0, 1, -1, 1]), None),
        (BLANK, np.eye(4), -np.eye(6)),
        (BLANK, np.eye(4), np.eye(3)),
    ],
)
def test_what_cannot_be_is_refused(
    views: Views, image: np.ndarray, pose: np.ndarray, covariance: np.ndarray | None
) -> None:
    locator = inline(views)
    with pytest.raises(BadInputError):
        locator.feed(image, pose, covariance, 0)
    assert locator.counts.key_frames == 0


def test_one_neighbour_is_refused() -> None:
    with pytest.raises(BadInputError, match="at least 2 show parallax"):
        LocatorSettings(neighbours=1)


def test_memory_is_bounded(views: Views) -> None:
    locator = inline(views, replace(QUICK, views_a_decision=1000, views_kept=6, frames_kept=5))
    for turn in range(8):
        for moment in moments(views, start_ns=(100 + 5 * turn) * NS_PER_S):
            locator.feed(BLANK, moment.world_from_cam, None, moment.stamp_ns)
    assert locator.counts.looked_at > 90
    assert len(locator._selector.window) == 5
    assert len(locator._engine._evidence) == 6
    assert len(locator._selector._poses) < 160
