"""Looks at one key frame after the other; decides by the evidence of the last what is there."""

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
from locate.robot.plume_tracks import PlumeTracks, PlumeUpdate, TrackState, ViewSpan, as_column
from locate.robot.search import PlumeSearch
from locate.robot.settings import LocatorSettings
from locate.robot.window import DetectionTask, EvidenceWindow, FrameWindow

FEWEST_VIEWS = 4
FEWEST_LOOKS = 3
SHARE_IN_SIGHT = 0.6
SPINE_POINTS = 9
BACKGROUND_STEP = 16
NEW_SHARE = 0.3


class PlumeEngine:
    """The part of a `Locator` that computes.

    Some threads may look at frames while another decides; none waits for the other, save at the
    end of a window.

    Args:
        searcher: Finds plumes in what was seen.
        settings: How much is kept, and how often is decided.

    Attributes:
        tracks: The plumes so far.
        inverse_depth: Typical of the background in the latest frame, 1 / m.
        background_in_world: (N, 3) points of the scene that the window looks at.
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
        self._followers: list[FixedLagSmoother] = []
        self._adding, self._deciding = threading.Lock(), threading.Lock()

    def look(self, task: DetectionTask, detector: Detector) -> list[PlumeUpdate]:
        """Looks at a key frame, keeps what it saw, and follows the plumes that are known.

        A frame in which the detector finds nothing to measure says nothing. The first frame of
        another window ends what was summed so far; the tracks stay. A frame of a window that has
        ended meanwhile is not kept.
        """
        news = self._begin(task.window)
        try:
            detection = detector.detect(task.frames, task.row)
        except BadInputError:
            detection = Detection.silent(task.key.image.shape, depth=True)
        with self._adding:
            if task.window is not self._window:
                return news
            self._evidence.add(task, detection)
            self._undecided += 1
            news += self._follow(task.key.number)
        if detection.inverse_depth is not None:
            known = detection.inverse_depth[detection.inverse_depth > 0]
            if known.size:
                self.inverse_depth = float(np.median(known))
        return news

    def _begin(self, window: FrameWindow) -> list[PlumeUpdate]:
        """Where this window is a new one: decides on what the last left, and begins it."""
        if not self._is_new(window):
            return []
        news = self.decide()
        with self._deciding, self._adding:
            if self._is_new(window):
                self._window, self._undecided = window, 0
                self._evidence.clear()
                self._followers.clear()
                self._searcher.forget()
                self.tracks.settle()
        return news

    def _is_new(self, window: FrameWindow) -> bool:
        return self._window is None or window.first > self._window.first

    @property
    def due(self) -> bool:
        """Enough views have come in since the last decision: the more there are, the more."""
        enough = max(self._settings.views_a_decision, NEW_SHARE * len(self._evidence))
        return self._undecided >= enough

    def decide(self) -> list[PlumeUpdate]:
        """Fuses the window and follows the plumes, where enough views are there and one is new.

        Views that came in meanwhile are followed up; of each plume only the latest is said.
        """
        with self._deciding:
            with self._adding:
                evidence, undecided = self._evidence.copy(), self._undecided
                self._undecided = 0
            return self._decided(evidence) if undecided and len(evidence) >= FEWEST_VIEWS else []

    def _decided(self, evidence: EvidenceWindow) -> list[PlumeUpdate]:
        poses, numbers, views = evidence.poses(), evidence.numbers, evidence.views()
        shared = SharedError.of(poses if self._settings.drift else [])
        own = trajectory_from_poses(shared.taken_out(poses), numbers, views.trajectory.camera)
        views = replace(views, trajectory=own)
        if np.isnan(views.unit):
            return []
        self.background_in_world = views.background_in_world(step=BACKGROUND_STEP)
        followers = self._searcher.search(views, poses, shared)
        span = ViewSpan(
            first=numbers[0], last=numbers[-1], stamp_ns=max(pose.stamp_ns for pose in poses)
        )
        with self._adding:
            news = self.tracks.update(
                [_with_shared(follower.plume, shared) for follower in followers],
                span,
                unit=views.unit,
                looked_at=lambda plume: looks(views, as_column(plume)) >= FEWEST_LOOKS,
            )
            self._followers = followers
            later = [number for number in self._evidence.numbers if number > span.last]
            news += [update for number in later for update in self._follow(number)]
            return list({update.plume.id: update for update in news}.values())

    def _follow(self, number: int) -> list[PlumeUpdate]:
        """What a key frame adds to what is known of the plumes that the last decision found."""
        pose, view = self._evidence.view(number)
        news = []
        for follower in self._followers:
            plume = follower.add(number, pose, view)
            if plume is not None:
                first, last = follower.span
                news += self.tracks.update(
                    [_with_shared(plume, follower.shared)],
                    ViewSpan(first=first, last=last, stamp_ns=pose.stamp_ns),
                    unit=follower.unit,
                    looked_at=lambda _plume: False,
                )
        return news

    @property
    def confirmed(self) -> list[Plume]:
        """The confirmed plumes, strongest evidence first."""
        plumes = [track.shown for track in self.tracks.all if track.state == TrackState.CONFIRMED]
        return sorted(plumes, key=lambda plume: -plume.evidence_nats)


def _with_shared(plume: Plume, shared: SharedError) -> Plume:
    covariance = plume.source_covariance + shared.at_point(plume.source)
    return replace(plume, source_covariance=covariance)


def looks(views: Views, column: PlumeColumn) -> int:
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
