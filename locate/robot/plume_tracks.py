"""Plumes tracked over time: which of those found now is which of those known."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum

import numpy as np
from scipy.optimize import minimize_scalar

from geometry.arrays import FloatArray
from locate.fusion.search.columns import Columns, PlumeColumn
from locate.fusion.search.fit import drop_duplicates
from locate.map.plume import Plume

CONFIRMED_PROBABILITY = 0.99
"""Of a plume that is confirmed (chosen; docs/robot.md states it)."""
MISSES_ALLOWED = 3
"""Searches in a row that may miss a plume before it counts as lost (chosen)."""
MOST_TRACKS = 256
"""Bounds the memory (chosen)."""
INCONSISTENT = 16.3
"""Squared Mahalanobis distance of two sources: chi-square of 3 degrees of freedom, 0.1 %."""


class TrackState(StrEnum):
    """How certain a plume is."""

    CANDIDATE = "candidate"
    CONFIRMED = "confirmed"
    LOST = "lost"


@dataclass(frozen=True, kw_only=True)
class PlumeUpdate:
    """What is now known of one plume.

    Attributes:
        plume: With its permanent id, source, covariance and probability; its views are key-frame
            numbers.
        state: Lost means: observed again, and not present any more.
        stamp_ns: Of the latest frame behind it.
    """

    plume: Plume
    state: TrackState
    stamp_ns: int


@dataclass(frozen=True, kw_only=True)
class PlumeTrack:
    """One plume over time.

    Attributes:
        shown: The best estimate.
        state: How certain it is.
        settled: The estimate that those of later windows are combined with.
        since: Number of the first key frame behind `settled`.
        until: Of the last one.
        misses: Searches in a row that observed its place and did not find it.
    """

    shown: Plume
    state: TrackState
    settled: Plume
    since: int
    until: int
    misses: int = 0


@dataclass(frozen=True, kw_only=True)
class ViewSpan:
    """The views behind an update: numbers of the first and last key frame, latest stamp."""

    first: int
    last: int
    stamp_ns: int


class PlumeTracks:
    """All plumes so far, at most `MOST_TRACKS`.

    Args:
        independent: Pose errors of views far apart in time are independent (GNSS, a surveyed
            map); otherwise (odometry) estimates are combined without assuming so.
    """

    def __init__(self, *, independent: bool) -> None:
        self._independent = independent
        self._tracks: dict[int, PlumeTrack] = {}
        self._next_id = 1

    @property
    def all_tracks(self) -> list[PlumeTrack]:
        """The tracks, by id."""
        return list(self._tracks.values())

    def update(
        self,
        found: Sequence[Plume],
        span: ViewSpan,
        *,
        unit: float,
        is_observed: Callable[[Plume], bool],
    ) -> list[PlumeUpdate]:
        """Takes the outcome of one search.

        Args:
            found: The plumes of the window, strongest first.
            span: The window.
            unit: The unit of length of fusion, metres.
            is_observed: True where the window's views would show a plume if it were present.

        Returns:
            One update for every plume that was found, or is lost as of now.
        """
        free = dict(
            sorted(self._tracks.items(), key=lambda item: item[1].state != TrackState.CONFIRMED)
        )
        touched = []
        for plume in found:
            number = next(
                (n for n, track in free.items() if is_same_plume(track.shown, plume, unit)), None
            )
            if number is None:
                number, self._next_id = self._next_id, self._next_id + 1
                self._tracks[number] = _begin_track(replace(plume, id=number), span)
            else:
                del free[number]
                self._tracks[number] = self._extend_track(self._tracks[number], plume, span)
            touched.append(number)
        touched += [number for number in free if self._count_miss(number, is_observed)]
        updates = [self._update_of(number, span.stamp_ns) for number in touched]
        self._drop_surplus()
        return updates

    def settle_estimates(self) -> None:
        """Ends the window: what is found next is found in other views."""
        for number, track in self._tracks.items():
            self._tracks[number] = replace(track, settled=track.shown, until=-1)

    def _extend_track(self, track: PlumeTrack, plume: Plume, span: ViewSpan) -> PlumeTrack:
        """The track with the window's present estimate; no view counts twice.

        While the window only grows, its estimate replaces the settled one. Once it slides, the
        more certain of the two is shown, until they share no view and are combined.
        """
        plume = replace(plume, id=track.shown.id)
        confirmed = (
            track.state == TrackState.CONFIRMED or plume.probability >= CONFIRMED_PROBABILITY
        )
        state = TrackState.CONFIRMED if confirmed else TrackState.CANDIDATE
        if track.since < span.first <= track.until:
            shown = _more_certain(plume, track.settled)
            return replace(track, shown=shown, state=state, misses=0)
        since = span.first
        if span.first > track.until:
            plume, since = self._combine_plumes(track.settled, plume), track.since
        return PlumeTrack(shown=plume, state=state, settled=plume, since=since, until=span.last)

    def _combine_plumes(self, settled: Plume, plume: Plume) -> Plume:
        if not are_consistent(settled, plume):
            return plume
        source, covariance = combine_estimates(
            (settled.source, settled.source_covariance),
            (plume.source, plume.source_covariance),
            independent=self._independent,
        )
        return replace(
            plume,
            source=source,
            source_covariance=covariance,
            evidence_nats=settled.evidence_nats + plume.evidence_nats,
            probability=max(settled.probability, plume.probability),
        )

    def _count_miss(self, number: int, is_observed: Callable[[Plume], bool]) -> bool:
        """Counts a miss; True where it makes the plume lost."""
        track = self._tracks[number]
        if track.state == TrackState.LOST or not is_observed(track.shown):
            return False
        misses = track.misses + 1
        lost = misses > MISSES_ALLOWED
        state = TrackState.LOST if lost else track.state
        self._tracks[number] = replace(track, misses=misses, state=state)
        return lost

    def _update_of(self, number: int, stamp_ns: int) -> PlumeUpdate:
        track = self._tracks[number]
        return PlumeUpdate(plume=track.shown, state=track.state, stamp_ns=stamp_ns)

    def _drop_surplus(self) -> None:
        """Drops the least certain, the oldest first, where there are too many."""
        surplus = len(self._tracks) - MOST_TRACKS
        rank = [TrackState.LOST, TrackState.CANDIDATE, TrackState.CONFIRMED].index
        by_certainty = sorted(self._tracks, key=lambda number: rank(self._tracks[number].state))
        for number in by_certainty[: max(surplus, 0)]:
            del self._tracks[number]


def _begin_track(plume: Plume, span: ViewSpan) -> PlumeTrack:
    confirmed = plume.probability >= CONFIRMED_PROBABILITY
    return PlumeTrack(
        shown=plume,
        state=TrackState.CONFIRMED if confirmed else TrackState.CANDIDATE,
        settled=plume,
        since=span.first,
        until=span.last,
    )


def _more_certain(a: Plume, b: Plume) -> Plume:
    return a if np.trace(a.source_covariance) <= np.trace(b.source_covariance) else b


def plume_column(plume: Plume) -> PlumeColumn:
    """The column of a plume's axis, extent and radii."""
    low, high = plume.extent_low, plume.extent_high
    lowest = plume.source + low * plume.axis
    rise = plume.axis / max(float(plume.axis[2]), 1e-3)
    height = max((high - low) * float(plume.axis[2]), 1e-3)
    radii = plume.radius_by_height[:, 1]
    opening = float(radii[-1] - radii[0]) / height
    return PlumeColumn(np.array([*lowest, rise[0], rise[1], height, radii[0], opening]))


def is_same_plume(a: Plume, b: Plume, unit: float) -> bool:
    """True where fusion would count the two as one plume."""
    return len(drop_duplicates(Columns.of([plume_column(a), plume_column(b)]), unit)) == 1


def are_consistent(a: Plume, b: Plume) -> bool:
    """True where the sources differ by no more than their covariances allow."""
    difference = a.source - b.source
    spread = a.source_covariance + b.source_covariance
    return float(difference @ np.linalg.solve(spread, difference)) < INCONSISTENT


PositionEstimate = tuple[FloatArray, FloatArray]


def combine_estimates(
    a: PositionEstimate, b: PositionEstimate, *, independent: bool
) -> PositionEstimate:
    """Combines two positions, each a (3,) mean and a (3, 3) covariance.

    Independent ones add their information. Otherwise covariance intersection holds whatever they
    share (Julier and Uhlmann, A non-divergent estimation algorithm in the presence of unknown
    correlations, ACC 1997, eq. 4), with the weight that makes the trace smallest.
    """
    information_a, information_b = np.linalg.inv(a[1]), np.linalg.inv(b[1])

    def weight_information(weight: float) -> PositionEstimate:
        first, second = (1.0, 1.0) if independent else (weight, 1 - weight)
        covariance = np.linalg.inv(first * information_a + second * information_b)
        mean = covariance @ (first * information_a @ a[0] + second * information_b @ b[0])
        return mean, covariance

    if independent:
        return weight_information(1.0)
    best = minimize_scalar(
        lambda weight: float(np.trace(weight_information(weight)[1])),
        bounds=(0, 1),
        method="bounded",
    )
    return weight_information(float(best.x))
