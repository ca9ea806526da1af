"""How a plume sways, estimated from the recording itself.

A plume leans now here, now there, and grows as it rises, so its axis sways with the height above
the source: not at all there, and the less the nearer. In proportion to it, as plumes are self-
similar (Morton, Taylor and Turner, Proc. R. Soc. A 234, 1956), or with its root, as what
turbulence carries wanders (Taylor, Proc. London Math. Soc. 20, 1921): the recording decides. Two
views that follow each other closely see the same sway, and a camera that moves on steadily cannot
tell a slow one from parallax. How far and how slowly a plume sways is therefore taken from the
scatter of its own sightings, and what remains unknown of both is averaged over. All views see the
same mean path, which wind bends: by how much is not known beforehand.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import product
from typing import NamedTuple

import numpy as np

from geometry.arrays import FloatArray
from locate.fusion.axis.least_squares import AxisFit
from locate.fusion.axis.sightings import AxisSightings

RATES = np.geomspace(0.005, 0.5, 7).tolist()
"""Standard deviations of the sway per unit of height that are tried: calm to stormy, by hand."""
GROWTHS = (0.5, 1.0, 2.0)
"""Powers of the height that sway may grow with: see `estimate_sway`."""
PROPORTIONAL_GROWTH = 1.0
"""The power that sway by a known rate grows with."""
INFLATIONS = (0.25, 0.5, 1.0, 2.0)
"""Factors of the stated sigmas that are tried; chosen by hand."""
SHARED_PARTS = (0.0, 0.9)
"""Shares of a sighting's variance that neighbouring views may have in common: all but none and
nearly all; chosen by hand."""
NEIGHBOUR_CORRELATION = 0.8
"""Of what neighbouring views share, from one view to the next; chosen by hand."""
PERSISTENCES = 4
"""Times over which sway is correlated that are tried; chosen by hand."""
NEAREST_UNITS = 0.02
"""Sightings lower above the source count as this high, units of fusion; chosen by hand."""
BEND = 0.3
"""Standard deviation of how far the mean path is off the axis at the highest sighting, per unit of
height; set with the sections of `sightings`."""
ROBUST_TURNS = 3
"""How often the weights of outliers are worked out, less one; chosen by hand."""
NEGLIGIBLE_NATS = 8.0
"""Hypotheses this much less likely than the best are dropped; chosen by hand."""


@dataclass(frozen=True, kw_only=True)
class Sway:
    """What the sightings of one plume scatter by, averaged over all that could explain it.

    Attributes:
        covariance_px2: (N, N) of what is common to sightings: the sway and what the evidence of
            neighbouring views has wrong alike, for those near in time and height; the bend.
        sigma_px: (N,) of what is each sighting's own; large for outliers.
        inflation: Of the sightings' own sigmas, outliers apart.
        shared_part: Of their variance that neighbouring views have in common.
        rate: Posterior mean of the sway's standard deviation per unit of height.
        persistence_s: Posterior (geometric) mean of the time over which it is correlated.
        hypotheses: All that could explain the sightings.
    """

    covariance_px2: FloatArray
    sigma_px: FloatArray
    inflation: float
    shared_part: float
    rate: float
    persistence_s: float
    hypotheses: tuple["SwayHypothesis", ...]

    def applied_to(self, sightings: AxisSightings, origin: float, unit: float) -> "Sway":
        """The same sway as other sightings of the plume scatter by it.

        Args:
            sightings: M of the axis.
            origin: Height of the source above the column's lowest point.
            unit: Of fusion (`Views.unit`), world units.
        """
        shape = _sway_covariance(sightings, origin, unit, self.persistence_s, PROPORTIONAL_GROWTH)
        alike = self.inflation**2 * self.shared_part * _shared_covariance(sightings)
        own = self.inflation * np.sqrt(1 - self.shared_part)
        return replace(
            self,
            covariance_px2=self.rate**2 * shape + alike + _bend_covariance(sightings, origin, unit),
            sigma_px=own * sightings.sigma_px,
        )


class SwayHypothesis(NamedTuple):
    """What sightings may scatter by; see `Sway`."""

    persistence_s: float
    growth: float
    rate: float
    inflation: float
    shared_part: float

    @property
    def own_variance(self) -> float:
        """Variance of a sighting's own error, in units of the one it states."""
        return self.inflation**2 * (1 - self.shared_part)


def estimate_sway(
    sightings: AxisSightings,
    origin: float,
    unit: float,
    poses_px2: FloatArray,
    prior: tuple[FloatArray, FloatArray],
    hypotheses: Sequence[SwayHypothesis] = (),
) -> Sway:
    """The posterior mean of the sway's covariance, by restricted likelihood on a grid.

    The covariance of two sightings at heights h <= k above the origin, t apart in time, is
    `rate^2 h k (h / k) exp(-t / persistence)` along each horizontal direction: sway in proportion
    to the height. Sway that grows with other powers of the height (`GROWTHS`) and reaches as far at
    the highest sighting is tried as well: with the square, a plume rises calmly and breaks up
    above; with the root, it wanders from the start. What a sighting has wrong by itself is either
    its own or mostly shared with the views next to it, which see nearly the same background behind
    the plume. A straight axis and a constant lean are free (Patterson and Thompson, Biometrika
    1971); sightings that fit no better than by chance lose weight as under Student's distribution.

    Args:
        sightings: N of the axis.
        origin: Height of the source above the column's lowest point.
        unit: Of fusion (`Views.unit`), world units.
        poses_px2: (N, N) covariance of the offsets due to the poses.
        prior: (4,) mean and (4, 4) information of the axis: x, y and slopes, as corrections.
        hypotheses: Those to try; empty: all.
    """
    grid = list(hypotheses) or _all_hypotheses(sightings.time_s)
    alike, bend = _shared_covariance(sightings), _bend_covariance(sightings, origin, unit)
    shapes = {
        (t, growth): _sway_covariance(sightings, origin, unit, t, growth)
        for t, growth in {(e.persistence_s, e.growth) for e in grid}
    }

    def common_covariance(e: SwayHypothesis) -> FloatArray:
        sway = e.rate**2 * shapes[e.persistence_s, e.growth]
        return np.asarray(sway + e.inflation**2 * e.shared_part * alike + bend)

    stated = sightings.sigma_px**2
    weight = np.ones(len(sightings))
    for turn in range(ROBUST_TURNS):
        fits = [
            AxisFit(
                sightings,
                common_covariance(e) + poses_px2 + np.diag(e.own_variance * stated / weight),
                prior,
            )
            for e in grid
        ]
        nats = np.array([fit.log_likelihood for fit in fits])
        if turn + 1 < ROBUST_TURNS:
            best = int(np.argmax(nats))
            weight = fits[best].student_weights(grid[best].own_variance * stated, weight)
        if turn + 2 == ROBUST_TURNS:
            grid = [grid[k] for k in np.flatnonzero(nats > nats[best] - NEGLIGIBLE_NATS)]
    share = np.exp(nats - nats.max())
    share /= share.sum()
    mean = SwayHypothesis(*(share @ np.array(grid)))
    inflation2 = float(share @ [e.inflation**2 for e in grid])
    own = float(share @ [e.own_variance for e in grid])
    return Sway(
        covariance_px2=sum(
            (p * common_covariance(e) for p, e in zip(share, grid, strict=True)), 0 * alike
        ),
        sigma_px=np.sqrt(own * stated / weight),
        inflation=float(np.sqrt(inflation2)),
        shared_part=1 - own / inflation2,
        rate=mean.rate,
        persistence_s=float(np.exp(share @ [np.log(e.persistence_s) for e in grid])),
        hypotheses=tuple(grid),
    )


def _all_hypotheses(time_s: FloatArray) -> list[SwayHypothesis]:
    every = product(_persistences_to_try(time_s), GROWTHS, RATES, INFLATIONS, SHARED_PARTS)
    return [SwayHypothesis(*e) for e in every]


def _persistences_to_try(time_s: FloatArray) -> list[float]:
    """From half the time between two views, where sway is noise, to twice the whole recording.

    Views of one instant see one sway, however long it lasts.
    """
    times = np.unique(time_s)
    if len(times) == 1:
        return [1.0]
    shortest, longest = np.median(np.diff(times)) / 2, 2 * np.ptp(times)
    return [float(t) for t in np.geomspace(shortest, longest, PERSISTENCES)]


def _sway_covariance(
    sightings: AxisSightings, origin: float, unit: float, persistence_s: float, growth: float
) -> FloatArray:
    """(N, N) covariance of the offsets, px^2, for a rate of one."""
    height = _heights_above_source(sightings, origin, unit)
    low, high = np.minimum.outer(height, height), np.maximum.outer(height, height)
    apart_s = np.abs(np.subtract.outer(sightings.time_s, sightings.time_s))
    lean = sightings.by_shift @ sightings.by_shift.T
    in_height = (low * high) ** growth * high.max() ** (2 - 2 * growth) * low / high
    return np.asarray(lean * in_height * np.exp(-apart_s / persistence_s))


def _bend_covariance(sightings: AxisSightings, origin: float, unit: float) -> FloatArray:
    """(N, N) covariance of the offsets, px^2, by a mean path that is a parabola.

    It leaves the source along the axis; `BEND` is the standard deviation of how far it is off the
    axis at the highest sighting, per unit of height.
    """
    height = _heights_above_source(sightings, origin, unit)
    lean = sightings.by_shift @ sightings.by_shift.T
    return np.asarray((BEND * np.outer(height, height) / height.max()) ** 2 * lean)


def _heights_above_source(sightings: AxisSightings, origin: float, unit: float) -> FloatArray:
    """(N,) heights above the source."""
    return np.maximum(sightings.height - origin, NEAREST_UNITS * unit)


def _shared_covariance(sightings: AxisSightings) -> FloatArray:
    """(N, N) covariance of the stated errors, px^2, were they shared with the views next to it."""
    apart = np.abs(np.subtract.outer(sightings.view, sightings.view))
    same_section = np.equal.outer(sightings.height, sightings.height)
    stated = np.outer(sightings.sigma_px, sightings.sigma_px)
    return np.asarray(stated * same_section * NEIGHBOUR_CORRELATION**apart)
