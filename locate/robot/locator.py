"""The streaming core: images and poses in, in any order; plumes out, as they become known."""

import logging
import threading
import time
from collections import deque
from collections.abc import Callable, Sequence
from functools import partial
from types import TracebackType
from typing import Self

import numpy as np

from detect.detection import Detector
from detect.registry import make_detector
from geometry.arrays import FloatArray, GreyImage
from geometry.camera import Camera
from locate import __version__
from locate.map.plume import PlumeMap
from locate.messages.poses import UNKNOWN_COVARIANCE, StampedPose
from locate.robot.engine import PlumeEngine
from locate.robot.keyframe_selector import KeyFrameSelector, LocatorCounts
from locate.robot.next_view import ViewSuggestion, rank_poses
from locate.robot.plume_tracks import PlumeUpdate, TrackState
from locate.robot.search import LocalPlumeSearch, PlumeSearch
from locate.robot.settings import LocatorSettings
from locate.robot.window import DetectionTask
from locate.robot.worker import (
    LEARNED_DETECTOR,
    WORKERS_AVAILABLE,
    DetectorWorker,
    PlumeSearchWorker,
)

MOST_PENDING_UPDATES = 1024
"""Updates kept for a program that does not fetch them; older ones are dropped (chosen)."""
AT_LEAST_EVERY_S = 5.0
"""Views that are too few for a decision of their own wait at most this long (chosen)."""

CLOSING_S, ENDING_S = 10.0, 1.0
"""How long `close` waits for work to be done, and for what is left once the processes are ended
(chosen)."""

log = logging.getLogger("locate.robot")


class Locator:
    """Finds plumes while a robot moves.

    Feed it images and poses as they come. It never blocks on the detector, which runs in a thread
    of its own and drops frames it has no time for, nor on searches, which another process runs.
    World: metric, Z up.

    Args:
        camera: That takes the images.
        settings: How much is kept, and how often is decided.
        detector: One of your own, which one thread uses; None takes ``registered``, see
            `detect.registry`, with the settings' neighbours, in `detector_workers` processes.
        threaded: False runs the detector inside `feed` and drops no frame: for recordings.

    Examples:
        >>> import locate
        >>> import numpy as np
        >>> from geometry.camera import Camera
        >>> camera = Camera.pinhole(64, 48, focal_px=60.0)
        >>> with locate.Locator(camera, threaded=False) as locator:
        ...     updates = locator.feed(np.zeros((48, 64), np.uint8), np.eye(4), None, stamp_ns=0)
        >>> updates
        []
    """

    def __init__(
        self,
        camera: Camera,
        *,
        settings: LocatorSettings | None = None,
        detector: Detector | None = None,
        threaded: bool = True,
    ) -> None:
        self.settings = settings or LocatorSettings()
        neighbours = self.settings.neighbours
        self._detector = detector or make_detector(LEARNED_DETECTOR, neighbours=neighbours)
        processes = threaded and WORKERS_AVAILABLE
        workers = self.settings.detector_workers - 1 if processes and detector is None else 0
        self._detector_workers = [
            DetectorWorker(self._detector, neighbours) for _ in range(workers)
        ]
        self._searcher: PlumeSearch = (PlumeSearchWorker if processes else LocalPlumeSearch)(
            self._detector.name, self.settings
        )
        self._pending_updates: deque[PlumeUpdate] = deque(maxlen=MOST_PENDING_UPDATES)
        self._changed = threading.Condition()
        self._detecting = 0
        self._deciding = self._pausing = self._ending = self._closing = False
        self._begin_session(camera)
        self._threaded = threaded
        detectors: list[Detector] = [self._detector, *self._detector_workers]
        work: list[Callable[[], None]] = [partial(self._run_detector, one) for one in detectors]
        self._threads = [
            threading.Thread(target=task, name="locate", daemon=True)
            for task in ([*work, self._run_decisions] if threaded else ())
        ]
        for thread in self._threads:
            thread.start()

    def feed(
        self,
        image: GreyImage,
        world_from_cam: FloatArray,
        covariance: FloatArray | None,
        stamp_ns: int,
    ) -> list[PlumeUpdate]:
        """Takes an image with its pose.

        Args:
            image: (H, W) uint8, grey, as the camera took it.
            world_from_cam: (4, 4) rigid, metres; camera x right, y down, z forward.
            covariance: (6, 6) of it in gtsam's order [rotation (rad), translation (m)], right
                tangent; None where unknown.
            stamp_ns: When both hold.

        Returns:
            What has become known since the last call of this or of `updates`.

        Raises:
            BadInputError: The image does not fit the camera, or the pose is not valid.
        """
        self._selector.check_image(image)
        self.feed_pose(world_from_cam, covariance, stamp_ns)
        self.feed_image(image, stamp_ns)
        return self.updates()

    def feed_pose(
        self, world_from_cam: FloatArray, covariance: FloatArray | None, stamp_ns: int
    ) -> None:
        """Takes a pose, late, early or out of order; see `feed`."""
        pose = StampedPose(
            stamp_ns=stamp_ns,
            world_from_cam=np.array(world_from_cam, dtype=float),
            covariance=UNKNOWN_COVARIANCE
            if covariance is None
            else np.array(covariance, dtype=float),
        )
        with self._changed:
            self._selector.add_pose(pose)
            self._changed.notify_all()
        self._process_inline()

    def feed_image(self, image: GreyImage, stamp_ns: int) -> None:
        """Takes an image; it waits for its pose if need be. See `feed`."""
        self._selector.check_image(image)
        with self._changed:
            self._selector.add_image(image, stamp_ns)
            self._changed.notify_all()
        self._process_inline()

    @property
    def counts(self) -> LocatorCounts:
        """What became of everything that was fed."""
        return self._selector.counts

    def updates(self) -> list[PlumeUpdate]:
        """What has become known since the last call."""
        with self._changed:
            updates = list(self._pending_updates)
            self._pending_updates.clear()
        return updates

    def finish(self, timeout_s: float | None = None) -> list[PlumeUpdate]:
        """Processes all frames that still wait, updates the plumes, and returns what is new.

        Args:
            timeout_s: Give up after this time; what is left then stays for the next call.
        """
        self._ending = True
        try:
            self._process_inline()
            with self._changed:
                self._changed.notify_all()
                if not self._changed.wait_for(self._is_idle, timeout_s):
                    return self.updates()
                self._deciding = True
            self._update_plumes()
        finally:
            self._ending = False
        return self.updates()

    def plume_map(self) -> PlumeMap:
        """The confirmed plumes as a map."""
        return PlumeMap(
            units="m",
            gravity=True,
            detector=self._detector.name,
            version=__version__,
            plumes=tuple(self._engine.confirmed_plumes),
        )

    def suggest(self, poses: Sequence[FloatArray]) -> list[ViewSuggestion]:
        """Where the camera should go next, best first; see `locate.robot.next_view`.

        Args:
            poses: (4, 4) world_from_cam each, those that the robot can reach.
        """
        engine = self._engine
        plumes = [
            track.shown for track in engine.tracks.all_tracks if track.state is not TrackState.LOST
        ]
        return rank_poses(
            plumes, engine.background_in_world, self._selector.rectifier.pinhole, poses
        )

    def set_camera(self, camera: Camera) -> None:
        """Goes on with another camera, in a new window; the plumes stay."""
        with self._changed:
            if camera != self._selector.rectifier.camera:
                self._selector.set_camera(camera)

    def reset(self) -> None:
        """Forgets everything, the plumes too."""
        with self._changed:
            self._pausing = True
            self._changed.wait_for(lambda: not self._detecting and not self._deciding)
            self._pausing = False
            self._pending_updates.clear()
            self._begin_session(self._selector.rectifier.camera)

    def close(self) -> None:
        """Ends the threads, once their current work is done, and the processes.

        Work that takes longer than `CLOSING_S` is given up.
        """
        with self._changed:
            self._closing = True
            self._changed.notify_all()
        self._join_threads(CLOSING_S)
        self._searcher.close()
        for worker in self._detector_workers:
            worker.close()
        if not self._join_threads(ENDING_S):
            log.warning("the detector is still at work; it ends with the program")

    def _join_threads(self, timeout_s: float) -> bool:
        """Waits for the threads to end; whether all have."""
        ends_at = time.monotonic() + timeout_s
        for thread in self._threads:
            thread.join(max(0.0, ends_at - time.monotonic()))
        return not any(thread.is_alive() for thread in self._threads)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    def _begin_session(self, camera: Camera) -> None:
        self._selector = KeyFrameSelector(camera, self.settings)
        self._engine = PlumeEngine(self._searcher, self.settings)

    def _is_idle(self) -> bool:
        return (
            not self._detecting and not self._deciding and not self._selector.window.waiting_count
        )

    def _take_task(self) -> DetectionTask | None:
        if self._pausing:
            return None
        return self._selector.window.take_task(
            newest=self._threaded and not self._ending, ending=self._ending
        )

    def _run_detector(self, detector: Detector) -> None:
        """A thread: processes one key frame after the other."""
        while True:
            with self._changed:
                task = None
                while not self._closing and (task := self._take_task()) is None:
                    self._changed.wait()
                if task is None:
                    return
                self._detecting += 1
            self._process_frame(task, detector)

    def _run_decisions(self) -> None:
        """A thread: updates the plumes after enough new views, and on the rest after a while.

        It rests as long as it worked: searches take half a processor at most.
        """
        rest_s = 0.0
        while True:
            with self._changed:
                self._changed.wait_for(lambda: self._closing, rest_s)
                self._changed.wait_for(
                    lambda: self._closing or self._engine.decision_due, AT_LEAST_EVERY_S
                )
                if self._closing:
                    return
                self._deciding = True
            started = time.monotonic()
            self._update_plumes()
            rest_s = time.monotonic() - started

    def _process_inline(self) -> None:
        """Processes all frames that are ready, and updates the plumes, where no thread does."""
        while not self._threaded and (task := self._take_task()) is not None:
            self._detecting += 1
            self._process_frame(task, self._detector)
            if self._engine.decision_due:
                self._update_plumes()

    def _process_frame(self, task: DetectionTask, detector: Detector) -> None:
        updates = self._run_guarded(lambda: self._engine.process_frame(task, detector))
        with self._changed:
            self.counts.looked_at += 1
            self._selector.inverse_depth = self._engine.inverse_depth
            self._pending_updates.extend(updates)
            self._detecting -= 1
            self._changed.notify_all()

    def _update_plumes(self) -> None:
        updates = self._run_guarded(self._engine.update_plumes)
        with self._changed:
            self._pending_updates.extend(updates)
            self._deciding = False
            self._changed.notify_all()

    def _run_guarded(self, work: Callable[[], list[PlumeUpdate]]) -> list[PlumeUpdate]:
        """Does the work; one frame's failure must not stop a robot."""
        try:
            return work()
        except Exception:
            log.exception("a key frame could not be worked on")
            self.counts.failures += 1
            return []
