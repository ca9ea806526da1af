"""Searches a window of evidence for plumes."""

from collections import deque
from collections.abc import Sequence
from dataclasses import replace
from typing import Protocol

import numpy as np

from detect.registry import DetectorChoice
from geometry.threads import with_one_thread
from locate.fusion.fuse import fuse
from locate.fusion.search.null import NULL_DRAWS, NullLevel, draw_strongest
from locate.fusion.views import Views
from locate.map.plume import Plume
from locate.messages.poses import StampedPose
from locate.robot.drift import SharedError
from locate.robot.fixed_lag_smoother import FixedLagSmoother
from locate.robot.settings import LocatorSettings

CANDIDATE_FALSE_ALARM = 0.3
"""Largest false-alarm probability of a candidate (chosen)."""
NULL_GROWTH = 2.0
"""Null draws are dropped once there are this many times their views (chosen)."""
EMPTY_NULL_LEVEL = NullLevel(strongest=np.zeros(0), location=0.0, scale=1.0)


class PlumeSearch(Protocol):
    """Finds the plumes of one window after the other."""

    def search_window(
        self, views: Views, poses: Sequence[StampedPose], shared: SharedError
    ) -> list[FixedLagSmoother]:
        """The plumes of a window, strongest first, each as a smoother for the views to come.

        Args:
            views: The evidence; the covariances of its poses exclude the shared error.
            poses: Those of the views, with their whole covariances.
            shared: The error that they share.
        """
        ...

    def forget_window(self) -> None:
        """Ends the window: its null draws do not hold for another."""
        ...

    def close(self) -> None:
        """Ends its process, if it has one."""
        ...


class LocalPlumeSearch:
    """A `PlumeSearch` in the calling process.

    Args:
        detector: Name of the one that the evidence is from.
        settings: How many views are kept, and how many null draws are made.
    """

    def __init__(self, detector: str, settings: LocatorSettings) -> None:
        self._clutter_nats = DetectorChoice.parse(detector).clutter_nats
        self._settings = settings
        self._rng = np.random.default_rng(settings.seed)
        self._null: deque[tuple[int, float]] = deque(maxlen=NULL_DRAWS)

    @with_one_thread
    def search_window(
        self, views: Views, poses: Sequence[StampedPose], shared: SharedError
    ) -> list[FixedLagSmoother]:
        """See `PlumeSearch`."""
        most = self._settings.views_kept
        return [
            FixedLagSmoother(plume, views, poses, shared, most=most)
            for plume in self._find_plumes(views)
        ]

    def forget_window(self) -> None:
        """See `PlumeSearch`."""
        self._null.clear()

    def close(self) -> None:
        """It has no process of its own."""

    def _find_plumes(self, views: Views) -> tuple[Plume, ...]:
        """The plumes of the window, strongest first.

        Where the detector's own clutter sets the level, null draws are made only once something
        exceeds it.
        """
        clutter = self._clutter_nats * len(views)

        def fuse_above(null: NullLevel) -> tuple[Plume, ...]:
            return fuse(
                views,
                seed=self._settings.seed,
                null=null,
                most_false_alarm=CANDIDATE_FALSE_ALARM,
                least_nats=clutter,
            ).plumes

        if not clutter:
            return fuse_above(self._null_level(views))
        found = fuse_above(EMPTY_NULL_LEVEL)
        if not found:
            return ()
        null = self._null_level(views)
        level = null.threshold(CANDIDATE_FALSE_ALARM)
        return tuple(
            replace(plume, probability=1 - null.false_alarm(plume.evidence_nats))
            for plume in found
            if plume.evidence_nats >= level
        )

    def _null_level(self, views: Views) -> NullLevel:
        """The level that chance reaches in the window: one new draw for each search.

        Draws of far fewer views than there are now would set the level too low, and are dropped.
        """
        count, box = len(views), views.volume()
        while self._null and self._null[0][0] * NULL_GROWTH < count:
            self._null.popleft()
        missing = max(self._settings.null_draws - len(self._null), 1)
        for _ in range(missing):
            self._null.append((count, draw_strongest(views, box, self._rng)))
        return NullLevel.from_draws([strength for _, strength in self._null])
