"""Detects in one key frame after the other; finds plumes by the evidence of the last views."""

import threading
from dataclasses import replace

import numpy as np

from detect.detection import Detection, Detector
from geometry.errors import BadInputError
from geometry.grid import lever_gate
from locate.fusion.search.columns import PlumeColumn
from locate.fusion.views import Views
from locate.map.plume import Plume
from locate.messages.poses import trajectory_from_poses
from locate.robot.drift import SharedError
from locate.robot.fixed_lag_smoother import FixedLagSmoother
from locate.robot.plume_tracks import PlumeTracks, PlumeUpdate, TrackState, ViewSpan, plume_column
from locate.robot.search import PlumeSearch
from locate.robot.settings import LocatorSettings
from locate.robot.window import DetectionTask, EvidenceWindow, FrameWindow

FEWEST_VIEWS = 4
"""Views below which a window is not searched (chosen)."""
FEWEST_OBSERVING_VIEWS = 3
"""Views that must observe a plume's place before not finding it counts as a miss (chosen)."""
SHARE_IN_SIGHT = 0.6
"""Share of its axis in the frame, at which a view observes a plume (chosen)."""
SPINE_POINTS = 9
"""Points along the axis at which that is checked."""
BACKGROUND_STEP = 16
"""Pixels between the points of the background that are kept."""
NEW_SHARE = 0.3
"""Share of the views that must be new before the window is searched again (chosen)."""


class PlumeEngine:
    """The part of a `Locator` that computes.

    Some threads may detect in frames while another searches; neither waits for the other, except
    at the end of a window.

    Args:
        searcher: Finds plumes in a window of views.
        settings: How much is kept, and how often plumes are searched.

    Attributes:
        tracks: The plumes so far.
        inverse_depth: Typical of the background in the latest frame, 1 / m.
        background_in_world: (N, 3) points of the background that the window observed.
    """

    def __init__(self, searcher: PlumeSearch, settings: LocatorSettings) -> None:
        self._searcher = searcher
        self._settings = settings
        self.tracks = PlumeTracks(independent=not settings.drift)
        self.inverse_depth = 1 / settings.expected_range_m
        self.background_in_world = np.zeros((0, 3))
        self._evidence = EvidenceWindow(most=settings.views_kept)
        self._undecided = 0
        self._window: FrameWindow | None = None
        self._smoothers: list[FixedLagSmoother] = []
        self._adding, self._deciding = threading.Lock(), threading.Lock()

    def process_frame(self, task: DetectionTask, detector: Detector) -> list[PlumeUpdate]:
        """Detects in a key frame, keeps its evidence, and updates the plumes that are known.

        A frame in which the detector finds nothing to measure holds no evidence. The first frame
        of another window ends the last one; the tracks stay. A frame of a window that has
        ended meanwhile is not kept.
        """
        updates = self._enter_window(task.window)
        try:
            detection = detector.detect(task.frames, task.row)
        except BadInputError:
            detection = Detection.without_evidence(task.key.image.shape, depth=True)
        with self._adding:
            if task.window is not self._window:
                return updates
            self._evidence.add(task, detection)
            self._undecided += 1
            updates += self._smooth_plumes(task.key.number)
        if detection.inverse_depth is not None:
            known = detection.inverse_depth[detection.inverse_depth > 0]
            if known.size:
                self.inverse_depth = float(np.median(known))
        return updates

    def _enter_window(self, window: FrameWindow) -> list[PlumeUpdate]:
        """Begins this window if it is a new one, after a last search of the one before."""
        if not self._is_new_window(window):
            return []
        updates = self.update_plumes()
        with self._deciding, self._adding:
            if self._is_new_window(window):
                self._window, self._undecided = window, 0
                self._evidence.clear()
                self._smoothers.clear()
                self._searcher.forget_window()
                self.tracks.settle_estimates()
        return updates

    def _is_new_window(self, window: FrameWindow) -> bool:
        return self._window is None or window.first > self._window.first

    @property
    def decision_due(self) -> bool:
        """True once enough views are new since the last search: `NEW_SHARE` of them, at least."""
        enough = max(self._settings.views_a_decision, NEW_SHARE * len(self._evidence))
        return self._undecided >= enough

    def update_plumes(self) -> list[PlumeUpdate]:
        """Searches the window for plumes, where it has enough views and a new one.

        Views that came in meanwhile are added; of each plume only the latest update is returned.
        """
        with self._deciding:
            with self._adding:
                evidence, undecided = self._evidence.copy(), self._undecided
                self._undecided = 0
            return (
                self._fuse_window(evidence) if undecided and len(evidence) >= FEWEST_VIEWS else []
            )

    def _fuse_window(self, evidence: EvidenceWindow) -> list[PlumeUpdate]:
        poses, numbers, views = evidence.poses(), evidence.numbers, evidence.merge_views()
        shared = SharedError.from_poses(poses if self._settings.drift else [])
        own = trajectory_from_poses(shared.remove_from(poses), numbers, views.trajectory.camera)
        views = replace(views, trajectory=own)
        if np.isnan(views.unit):
            return []
        self.background_in_world = views.background_in_world(step=BACKGROUND_STEP)
        smoothers = self._searcher.search_window(views, poses, shared)
        span = ViewSpan(
            first=numbers[0], last=numbers[-1], stamp_ns=max(pose.stamp_ns for pose in poses)
        )
        with self._adding:
            updates = self.tracks.update(
                [_add_shared_error(smoother.plume, shared) for smoother in smoothers],
                span,
                unit=views.unit,
                is_observed=lambda plume: (
                    count_observing_views(views, plume_column(plume)) >= FEWEST_OBSERVING_VIEWS
                ),
            )
            self._smoothers = smoothers
            later = [number for number in self._evidence.numbers if number > span.last]
            updates += [update for number in later for update in self._smooth_plumes(number)]
            return list({update.plume.id: update for update in updates}.values())

    def _smooth_plumes(self, number: int) -> list[PlumeUpdate]:
        """Adds a key frame to the estimates of the plumes that the last search found."""
        pose, view = self._evidence.view_of(number)
        updates = []
        for smoother in self._smoothers:
            plume = smoother.add_view(number, pose, view)
            if plume is not None:
                first, last = smoother.view_range
                updates += self.tracks.update(
                    [_add_shared_error(plume, smoother.shared)],
                    ViewSpan(first=first, last=last, stamp_ns=pose.stamp_ns),
                    unit=smoother.unit,
                    is_observed=lambda _plume: False,
                )
        return updates

    @property
    def confirmed_plumes(self) -> list[Plume]:
        """The confirmed plumes, strongest evidence first."""
        plumes = [
            track.shown for track in self.tracks.all_tracks if track.state == TrackState.CONFIRMED
        ]
        return sorted(plumes, key=lambda plume: -plume.evidence_nats)


def _add_shared_error(plume: Plume, shared: SharedError) -> Plume:
    covariance = plume.source_covariance + shared.covariance_at(plume.source)
    return replace(plume, source_covariance=covariance)


def count_observing_views(views: Views, column: PlumeColumn) -> int:
    """How many views have most of a column in the frame, before a background that shows it."""
    heights = np.linspace(0, column.height, SPINE_POINTS)
    points = column.axis_points(heights)
    height, width = views.llr.shape[1:]
    count = 0
    for i in range(len(views)):
        in_cam = views.trajectory.world_to_cam(i, points)
        pixel = np.rint(views.trajectory.camera.project(in_cam))
        inside = np.all((pixel >= 0) & (pixel < [width, height]), axis=1)
        x, y = np.where(inside[:, None], pixel, 0).astype(int).T
        gate = lever_gate(in_cam[:, 2].astype(np.float32), views.inverse_depth[i][y, x])
        count += bool(((gate > 0) & inside).mean() >= SHARE_IN_SIGHT)
    return count
