import os
import signal
import threading
from collections.abc import Iterator
from dataclasses import replace

import cv2
import numpy as np
import pytest

from detect.detection import Frames
from detect.registry import make_detector
from geometry.errors import BadInputError
from locate.fusion.views import Views
from locate.messages.poses import StampedPose
from locate.robot import Locator, LocatorSettings, TrackState
from locate.robot.drift import SharedError
from locate.robot.search import LocalPlumeSearch
from locate.robot.worker import DetectorWorker, PlumeSearchWorker
from locate.simulation.evidence import ColumnTruth
from tests.robot.drive import BLANK, Oracle, moments

QUICK = LocatorSettings(lag=2, views_kept=16, null_draws=2, drift=False)
NOTHING_SHARED = SharedError.from_poses([])


@pytest.fixture
def process() -> Iterator[PlumeSearchWorker]:
    process = PlumeSearchWorker("oracle", QUICK)
    yield process
    process.close()


@pytest.fixture(scope="module")
def poses(views: Views) -> list[StampedPose]:
    poses = []
    for moment in moments(views):
        assert moment.covariance is not None
        poses.append(
            StampedPose(
                stamp_ns=moment.stamp_ns,
                world_from_cam=moment.world_from_cam,
                covariance=moment.covariance,
            )
        )
    return poses


def test_another_process_finds_what_this_one_finds(
    process: PlumeSearchWorker, views: Views, poses: list[StampedPose]
) -> None:
    (here,) = LocalPlumeSearch("oracle", QUICK).search_window(views, poses, NOTHING_SHARED)
    process.forget_window()
    (there,) = process.search_window(views, poses, NOTHING_SHARED)
    np.testing.assert_array_equal(there.plume.source, here.plume.source)
    np.testing.assert_array_equal(there.plume.source_covariance, here.plume.source_covariance)
    assert there.plume.probability == here.plume.probability
    assert there.view_range == here.view_range == (0, 11)


def test_failed_search_reports_its_error_and_the_next_works(
    process: PlumeSearchWorker, views: Views, poses: list[StampedPose]
) -> None:
    with pytest.raises(RuntimeError, match=r"AttributeError.*no attribute 'remove_from'"):
        process.search_window(views, poses, None)  # type: ignore[arg-type]
    assert len(process.search_window(views, poses, NOTHING_SHARED)) == 1


def test_dead_process_is_replaced(
    process: PlumeSearchWorker, views: Views, poses: list[StampedPose]
) -> None:
    process._search._process.send_signal(signal.SIGKILL)
    process._search._process.wait()
    with pytest.raises(RuntimeError, match="died"):
        process.search_window(views, poses, NOTHING_SHARED)
    assert len(process.search_window(views, poses, NOTHING_SHARED)) == 1


def test_detector_worker_equals_the_detector_in_this_process(views: Views) -> None:
    camera = views.trajectory.camera.scaled(0.5)
    white = np.random.default_rng(0).normal(size=(camera.height, camera.width))
    texture = cv2.GaussianBlur(white, (0, 0), 2.0)
    scene = (127 + 40 * texture / texture.std()).clip(0, 255).astype(np.uint8)
    images = [np.roll(scene, 2 * k, axis=1) for k in range(5)]
    trajectory = replace(views.trajectory.take(range(5)), camera=camera)
    frames = Frames(images=images, trajectory=trajectory)
    detector = make_detector("registered", neighbours=2)
    worker = DetectorWorker(detector, 2)
    try:
        expected = detector.detect(frames, 2)
        found = worker.detect(frames, 2)
        np.testing.assert_allclose(found.displacement, expected.displacement, atol=1e-3)
        np.testing.assert_allclose(found.llr, expected.llr, atol=0.01)
        assert np.isfinite(found.sigma_px).any()
        with pytest.raises(BadInputError, match="takes camera poses"):
            worker.detect(replace(frames, trajectory=None), 2)
    finally:
        worker.close()


def test_several_workers_leave_no_frame_and_no_process(views: Views) -> None:
    rng = np.random.default_rng(0)
    textured = rng.integers(0, 255, BLANK.shape, np.uint8)
    settings = replace(
        QUICK, detector_workers=2, neighbours=2, frames_kept=20, views_a_decision=1000
    )
    with Locator(views.trajectory.camera, settings=settings) as locator:
        for moment in moments(views):
            locator.feed(textured, moment.world_from_cam, moment.covariance, moment.stamp_ns)
        locator.finish(timeout_s=60)
        assert locator.counts.failures == 0
        assert locator.counts.looked_at == locator.counts.key_frames == 12
        assert len(locator._engine._evidence) == 12
        processes = [
            locator._detector_workers[0]._detector._process,
            locator._searcher._search._process,
        ]
    assert all(process.poll() is not None for process in processes)


def test_process_ends_with_its_pipe(process: PlumeSearchWorker) -> None:
    process._search._pipe.close()
    assert process._search._process.wait(timeout=20) == 0


def test_plume_is_confirmed_by_threads_and_a_process(views: Views, truth: ColumnTruth) -> None:
    updates = []
    with Locator(views.trajectory.camera, settings=QUICK, detector=Oracle(views)) as locator:
        for moment in moments(views):
            updates += locator.feed(
                moment.image, moment.world_from_cam, moment.covariance, moment.stamp_ns
            )
        updates += locator.finish(timeout_s=60)
        assert locator.counts.failures == 0
        (plume,) = locator.plume_map().plumes
    assert updates[-1].state is TrackState.CONFIRMED
    error = plume.source - truth.source
    assert error @ np.linalg.solve(plume.source_covariance, error) < 16


def test_close_does_not_wait_for_a_process_that_stands_still(
    process: PlumeSearchWorker, views: Views, poses: list[StampedPose]
) -> None:
    os.kill(process._search._process.pid, signal.SIGSTOP)
    ended: list[Exception] = []

    def search() -> None:
        try:
            process.search_window(views, poses, NOTHING_SHARED)
        except RuntimeError as error:
            ended.append(error)

    thread = threading.Thread(target=search, daemon=True)
    thread.start()
    process.close()
    thread.join(60)
    assert not thread.is_alive()
    assert "died" in str(ended[0])
    assert process._search._process.poll() is not None


def test_locator_closes_over_a_process_that_stands_still(
    views: Views, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("locate.robot.locator.CLOSING_S", 0.1)
    locator = Locator(views.trajectory.camera, settings=QUICK, detector=Oracle(views))
    assert isinstance(locator._searcher, PlumeSearchWorker)
    os.kill(locator._searcher._search._process.pid, signal.SIGSTOP)
    for moment in moments(views):
        locator.feed(BLANK, moment.world_from_cam, moment.covariance, moment.stamp_ns)
    closing = threading.Thread(target=locator.close, daemon=True)
    closing.start()
    closing.join(60)
    assert not closing.is_alive()
