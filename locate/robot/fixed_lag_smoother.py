"""A fixed-lag smoother: a new view of a known plume updates its estimate at once.

Searching a window takes seconds. Between two searches the axis of a plume that the last one found
is measured in every new view, and the linear graph of the last views is solved again, with the
sway that the search found; see `locate.fusion.axis.graph`. Cost and memory depend on
the window alone.
"""

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, fields, replace

import numpy as np

from geometry.arrays import FloatArray
from locate.fusion.axis.estimate import AxisEstimate
from locate.fusion.axis.graph import estimate_axis
from locate.fusion.axis.sightings import AxisSightings, sight_axis
from locate.fusion.axis.sway import Sway
from locate.fusion.views import Views
from locate.map.plume import Plume
from locate.messages.poses import StampedPose, trajectory_from_poses
from locate.robot.drift import SharedError
from locate.robot.plume_tracks import plume_column

LEAST_VARIANCE_SHARE = 1e-3
"""Smallest variance of a covariance, as a share of its largest (chosen)."""


@dataclass(frozen=True, kw_only=True)
class ViewMeasurement:
    """The axis as one view measured it.

    Attributes:
        number: Of the key frame.
        pose: Of the camera; its covariance is without the shared error.
        sightings: Of the axis, if any.
    """

    number: int
    pose: StampedPose
    sightings: AxisSightings


class FixedLagSmoother:
    """Updates one plume from the search that found it until the next.

    Args:
        plume: As the search found it; its covariance without the error that all views share.
        views: Those of the search.
        poses: Theirs.
        shared: The error that they share.
        most: How many views are kept.

    Attributes:
        plume: As given.
        shared: As given.
        unit: The unit of length of fusion, m.
    """

    def __init__(
        self,
        plume: Plume,
        views: Views,
        poses: Sequence[StampedPose],
        shared: SharedError,
        *,
        most: int,
    ) -> None:
        self.plume = plume
        self.shared = shared
        self.unit = views.unit
        self._camera = views.trajectory.camera
        self._column = plume_column(plume)
        self._height = float(plume.source[2] - self._column.lowest_z)
        self._measurements: deque[ViewMeasurement] = deque(maxlen=most)
        sightings = sight_axis(views, self._column)
        self._bending_sign = int(np.sign(sightings.bending_sign.sum()))
        for row, pose in enumerate(shared.remove_from(poses)):
            number = int(views.trajectory.indices[row])
            part = _select_sightings(sightings, sightings.view == row)
            self._measurements.append(ViewMeasurement(number=number, pose=pose, sightings=part))
        first = estimate_axis(
            views.trajectory, self._column, sightings, self.unit, origin=self._height
        )
        self._sway = None if first is None else first.sway
        self._first = self._estimate_axis()

    def add_view(self, number: int, pose: StampedPose, view: Views) -> Plume | None:
        """Takes the next view; the plume as it is now, None where this view does not show it.

        Args:
            number: Of the key frame.
            pose: Where it was taken.
            view: Its evidence: one row.
        """
        sightings = sight_axis(view, self._column, self._bending_sign)
        if self._first is None or not len(sightings):
            return None
        (own,) = self.shared.remove_from([pose])
        self._measurements.append(ViewMeasurement(number=number, pose=own, sightings=sightings))
        now = self._estimate_axis()
        return None if now is None else self._update_plume(self._first, now)

    @property
    def view_range(self) -> tuple[int, int]:
        """Numbers of the first and the last view behind it."""
        return self._measurements[0].number, self._measurements[-1].number

    def _estimate_axis(self) -> AxisEstimate | None:
        if self._sway is None:
            return None
        measurements = list(self._measurements)
        trajectory = trajectory_from_poses(
            [measurement.pose for measurement in measurements],
            [measurement.number for measurement in measurements],
            self._camera,
        )
        sightings = _concatenate_sightings(
            [measurement.sightings for measurement in measurements], trajectory.times_s
        )
        sway: Sway = self._sway.applied_to(sightings, self._height, self.unit)
        return estimate_axis(
            trajectory, self._column, sightings, self.unit, origin=self._height, sway=sway
        )

    def _update_plume(self, first: AxisEstimate, now: AxisEstimate) -> Plume:
        """The plume, changed as its axis and the covariance of that were since the search."""
        before, covariance_before = first.point_at(self._height)
        after, covariance_after = now.point_at(self._height)
        rest = _make_positive(self.plume.source_covariance - covariance_before)
        sigma_ratio = now.direction_sigma_rad / first.direction_sigma_rad
        views = {*self.plume.views, *(g.number for g in self._measurements if len(g.sightings))}
        return replace(
            self.plume,
            source=self.plume.source + after - before,
            source_covariance=covariance_after + rest,
            axis=now.direction,
            axis_sigma_rad=sigma_ratio * self.plume.axis_sigma_rad,
            views=tuple(sorted(views)),
        )


def _select_sightings(sightings: AxisSightings, rows: np.ndarray) -> AxisSightings:
    parts = {field.name: getattr(sightings, field.name)[rows] for field in fields(sightings)}
    return AxisSightings(**parts)


def _concatenate_sightings(parts: Sequence[AxisSightings], times_s: FloatArray) -> AxisSightings:
    """The sightings of several views as one; each view's row is its place among the parts."""
    view = np.repeat(np.arange(len(parts)), [len(part) for part in parts])
    whole = {
        field.name: np.concatenate([getattr(part, field.name) for part in parts])
        for field in fields(AxisSightings)
    }
    return AxisSightings(**{**whole, "view": view, "time_s": times_s[view]})


def _make_positive(covariance: FloatArray) -> FloatArray:
    """The nearest covariance whose variances are not below a small share of the largest."""
    values, vectors = np.linalg.eigh(covariance)
    least = max(float(values[-1]), 1e-12) * LEAST_VARIANCE_SHARE
    return np.asarray(vectors * np.maximum(values, least) @ vectors.T)
