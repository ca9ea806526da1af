"""Looks at one key frame after the other; decides by the evidence of the last what is there."""

import threading
from collections import deque
from dataclasses import replace

import numpy as np

from detect.detection import Detector
from detect.registered.detector import silent
from geometry.arrays import FloatArray
from geometry.errors import BadInputError
from geometry.grid import lever_gate
from locate.detectors import clutter_nats
from locate.fusion.column import HEIGHT, spine
from locate.fusion.fuse import fuse
from locate.fusion.null import NULL_DRAWS, NullLevel, draw_strongest
from locate.fusion.views import Views
from locate.plume import Plume
from locate.robot.drift import SharedError
from locate.robot.follower import Follower
from locate.robot.poses import as_trajectory
from locate.robot.settings import Settings
from locate.robot.tracks import Span, State, Tracks, Update, as_column
from locate.robot.window import EvidenceWindow, FrameWindow, Task

CANDIDATE_FALSE_ALARM = 0.3
FEWEST_VIEWS = 4
FEWEST_LOOKS = 3
SHARE_IN_SIGHT = 0.6
SPINE_POINTS = 9
NULL_GROWTH = 2.0
NOTHING_BY_CHANCE = NullLevel(strongest=np.zeros(0), location=0.0, scale=1.0)
BACKGROUND_STEP = 16
NEW_SHARE = 0.3


class Engine:
    """The part of a `Locator` that computes.

    One thread may look at frames while another decides; neither waits for the other, save at
    the end of a window.

    Args:
        detector: Looks at the frames.
        settings: How much is kept, and how often is decided.

    Attributes:
        tracks: The plumes so far.
        inverse_depth: Typical of the background in the latest frame, 1 / m.
        background_in_world: (N, 3) points of the scene that the window looks at.
    """

    def __init__(self, detector: Detector, settings: Settings) -> None:
        self._detector = detector
        self._settings = settings
        self._rng = np.random.default_rng(settings.seed)
        self.tracks = Tracks(independent=not settings.drift)
        self.inverse_depth = 1 / settings.expected_range_m
        self.background_in_world = np.zeros((0, 3))
        self._evidence = EvidenceWindow(most=settings.views_kept)
        self._null: deque[tuple[int, float]] = deque(maxlen=NULL_DRAWS)
        self._undecided = 0
        self._window: FrameWindow | None = None
        self._followers: list[Follower] = []
        self._adding, self._deciding = threading.Lock(), threading.Lock()

    def look(self, task: Task) -> list[Update]:
        """Looks at a key frame, keeps what it saw, and follows the plumes that are known.

        A frame in which the detector finds nothing to measure says nothing. The first frame of
        another window ends what was summed so far; the tracks stay.
        """
        news = self._begin(task.window) if task.window is not self._window else []
        try:
            detection = self._detector.detect(task.frames, task.row)
        except BadInputError:
            detection = silent(task.key.image.shape)
        with self._adding:
            self._evidence.add(task, detection)
            self._undecided += 1
            news += self._follow(task.key.number)
        if detection.inverse_depth is not None:
            known = detection.inverse_depth[detection.inverse_depth > 0]
            if known.size:
                self.inverse_depth = float(np.median(known))
        return news

    def _begin(self, window: FrameWindow) -> list[Update]:
        """Decides on what the last window left, and begins another."""
        news = self.decide()
        with self._deciding, self._adding:
            self._window, self._undecided = window, 0
            self._evidence.clear()
            self._followers.clear()
            self._null.clear()
            self.tracks.settle()
        return news

    @property
    def due(self) -> bool:
        """Enough views have come in since the last decision: the more there are, the more."""
        enough = max(self._settings.views_a_decision, NEW_SHARE * len(self._evidence))
        return self._undecided >= enough

    def decide(self) -> list[Update]:
        """Fuses the window and follows the plumes, where enough views are there and one is new."""
        with self._deciding:
            with self._adding:
                evidence, undecided = self._evidence.copy(), self._undecided
                self._undecided = 0
            return self._decided(evidence) if undecided and len(evidence) >= FEWEST_VIEWS else []

    def _decided(self, evidence: EvidenceWindow) -> list[Update]:
        poses, numbers, views = evidence.poses(), evidence.numbers, evidence.views()
        shared = SharedError.of(poses if self._settings.drift else [])
        own = as_trajectory(shared.taken_out(poses), numbers, views.trajectory.camera)
        views = replace(views, trajectory=own)
        if np.isnan(views.unit):
            return []
        self.background_in_world = views.background_in_world(step=BACKGROUND_STEP)
        plumes = self._searched(views)
        span = Span(
            first=numbers[0], last=numbers[-1], stamp_ns=max(pose.stamp_ns for pose in poses)
        )
        followers = [
            Follower(plume, views, poses, shared, most=self._settings.views_kept)
            for plume in plumes
        ]
        with self._adding:
            news = self.tracks.update(
                [_with_shared(plume, shared) for plume in plumes],
                span,
                unit=views.unit,
                looked_at=lambda plume: looks(views, as_column(plume)) >= FEWEST_LOOKS,
            )
            self._followers = followers
            later = [number for number in self._evidence.numbers if number > span.last]
            return news + [update for number in later for update in self._follow(number)]

    def _searched(self, views: Views) -> tuple[Plume, ...]:
        """The plumes of the window, strongest first.

        Where the detector's own clutter sets the level, what chance makes is drawn only once
        something stands above that.
        """
        clutter = clutter_nats(self._detector.name) * len(views)

        def search(null: NullLevel) -> tuple[Plume, ...]:
            return fuse(
                views,
                seed=self._settings.seed,
                null=null,
                most_false_alarm=CANDIDATE_FALSE_ALARM,
                least_nats=clutter,
            ).plumes

        if not clutter:
            return search(self._null_level(views))
        found = search(NOTHING_BY_CHANCE)
        if not found:
            return ()
        null = self._null_level(views)
        level = null.threshold(CANDIDATE_FALSE_ALARM)
        return tuple(
            replace(plume, probability=1 - null.false_alarm(plume.evidence_nats))
            for plume in found
            if plume.evidence_nats >= level
        )

    def _follow(self, number: int) -> list[Update]:
        """What a key frame adds to what is known of the plumes that the last decision found."""
        pose, view = self._evidence.view(number)
        news = []
        for follower in self._followers:
            plume = follower.add(number, pose, view)
            if plume is not None:
                first, last = follower.span
                news += self.tracks.update(
                    [_with_shared(plume, follower.shared)],
                    Span(first=first, last=last, stamp_ns=pose.stamp_ns),
                    unit=follower.unit,
                    looked_at=lambda _plume: False,
                )
        return news

    def _null_level(self, views: Views) -> NullLevel:
        """What chance makes of the window: one new draw a decision, all anew while it grows.

        Draws of far fewer views than there are now would set the level too low.
        """
        count, box = len(views), views.volume()
        while self._null and self._null[0][0] * NULL_GROWTH < count:
            self._null.popleft()
        missing = max(self._settings.null_draws - len(self._null), 1)
        for _ in range(missing):
            self._null.append((count, draw_strongest(views, box, views.unit, self._rng)))
        return NullLevel.fitted([strength for _, strength in self._null])

    @property
    def confirmed(self) -> list[Plume]:
        """The confirmed plumes, strongest evidence first."""
        plumes = [track.shown for track in self.tracks.all if track.state == State.CONFIRMED]
        return sorted(plumes, key=lambda plume: -plume.evidence_nats)


def _with_shared(plume: Plume, shared: SharedError) -> Plume:
    covariance = plume.source_covariance + shared.at_point(plume.source)
    return replace(plume, source_covariance=covariance)


def looks(views: Views, column: FloatArray) -> int:
    """How many views have most of a column in the frame, before a background that shows it."""
    heights = np.linspace(0, column[HEIGHT], SPINE_POINTS)
    points = spine(column[None], heights[None])[0]
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
