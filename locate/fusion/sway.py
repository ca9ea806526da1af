"""How a plume sways, judged from the recording itself.

A plume leans now here, now there, and grows as it rises, so its axis sways with the height above
the source: not at all there, and the less the nearer. In proportion to it, as plumes are self-
similar (Morton, Taylor and Turner, Proc. R. Soc. A 234, 1956), or with its root, as what
turbulence carries wanders (Taylor, Proc. London Math. Soc. 20, 1921): the recording decides. Two
views that follow each other closely see the same sway, and a camera that moves on steadily cannot
tell a slow one from parallax. How far and how slowly a plume sways is therefore taken from the
scatter of its own sightings, and what remains unknown of both is averaged over.
"""

from dataclasses import dataclass
from itertools import product

import numpy as np

from geometry.arrays import FloatArray
from locate.fusion.axis import AxisSightings

RATES = np.geomspace(0.005, 0.5, 7)
GROWTHS = (0.5, 0.75, 1.0, 2.0)
IN_PROPORTION = 1.0
INFLATIONS = (0.25, 0.5, 1.0, 2.0)
PERSISTENCES = 4
NEAREST_UNITS = 0.02
STUDENT_FREEDOM = 4.0
ROBUST_TURNS = 3


@dataclass(frozen=True, kw_only=True)
class Sway:
    """What the sightings of one plume scatter by, averaged over all that could explain it.

    Attributes:
        covariance_px2: (N, N) of the sway, common to sightings near in time and height.
        sigma_px: (N,) of what is each sighting's own; large for outliers.
        inflation: Of the sightings' own sigmas, outliers apart.
        rate: Posterior mean of the sway's standard deviation per unit of height.
        persistence_s: Posterior (geometric) mean of the time over which it is correlated.
    """

    covariance_px2: FloatArray
    sigma_px: FloatArray
    inflation: float
    rate: float
    persistence_s: float

    def again(self, sightings: AxisSightings, origin: float, unit: float) -> "Sway":
        """The same sway as other sightings of the plume scatter by it.

        Args:
            sightings: M of the axis.
            origin: Height of the source above the column's lowest point.
            unit: The yardstick of fusion, world units.
        """
        shape = _shape(sightings, origin, unit, self.persistence_s, IN_PROPORTION)
        return Sway(
            covariance_px2=self.rate**2 * shape,
            sigma_px=self.inflation * sightings.sigma_px,
            inflation=self.inflation,
            rate=self.rate,
            persistence_s=self.persistence_s,
        )


def estimate_sway(
    sightings: AxisSightings,
    origin: float,
    unit: float,
    poses_px2: FloatArray,
    prior: tuple[FloatArray, FloatArray],
) -> Sway:
    """The posterior mean of the sway's covariance, by restricted likelihood on a grid.

    The covariance of two sightings at heights h <= k above the origin, t apart in time, is
    `rate^2 h k (h / k) exp(-t / persistence)` along each horizontal direction: sway in proportion
    to the height. Sway that grows with other powers of the height (`GROWTHS`) and reaches as far at
    the highest sighting is tried as well: with the square, a plume rises calmly and breaks up
    above; with the root, it wanders from the start. A straight axis and a constant lean are free
    (Patterson and Thompson, Biometrika 1971); sightings that fit no better than by chance lose
    weight as under Student's distribution.

    Args:
        sightings: N of the axis.
        origin: Height of the source above the column's lowest point.
        unit: The yardstick of fusion, world units.
        poses_px2: (N, N) covariance of the offsets due to the poses.
        prior: (4,) mean and (4, 4) information of the axis: x, y and slopes, as corrections.
    """
    times = _persistences(sightings.time_s)
    shapes = {
        (t, growth): _shape(sightings, origin, unit, t, growth)
        for t, growth in product(times, GROWTHS)
    }
    weight = np.ones(len(sightings))
    grid = list(product(shapes, RATES, INFLATIONS))
    for turn in range(ROBUST_TURNS):
        own = [(factor * sightings.sigma_px) ** 2 for factor in INFLATIONS]
        variances = dict(zip(INFLATIONS, own, strict=True))
        fits = [
            _Fit(
                sightings,
                rate**2 * shapes[key] + poses_px2 + np.diag(variances[factor] / weight),
                prior,
            )
            for key, rate, factor in grid
        ]
        log_likelihood = np.array([fit.log_likelihood for fit in fits])
        if turn + 1 < ROBUST_TURNS:
            best = int(np.argmax(log_likelihood))
            weight = fits[best].student_weight(variances[grid[best][2]], weight)
    share = np.exp(log_likelihood - log_likelihood.max())
    share /= share.sum()
    keys, rates, factors = zip(*grid, strict=True)
    covariance = np.zeros_like(poses_px2)
    for p, (key, rate, _) in zip(share, grid, strict=True):
        covariance += p * rate**2 * shapes[key]
    return Sway(
        covariance_px2=covariance,
        sigma_px=sightings.sigma_px * np.sqrt(share @ np.square(factors) / weight),
        inflation=float(np.sqrt(share @ np.square(factors))),
        rate=float(share @ np.array(rates)),
        persistence_s=float(np.exp(share @ np.log([t for t, _ in keys]))),
    )


def _persistences(time_s: FloatArray) -> FloatArray:
    """From half the time between two views, where sway is noise, to twice the whole recording.

    Views of one instant see one sway, however long it lasts.
    """
    times = np.unique(time_s)
    if len(times) == 1:
        return np.ones(1)
    return np.geomspace(np.median(np.diff(times)) / 2, 2 * np.ptp(times), PERSISTENCES)


def _shape(
    sightings: AxisSightings, origin: float, unit: float, persistence_s: float, growth: float
) -> FloatArray:
    """(N, N) covariance of the offsets, px^2, for a rate of one."""
    height = np.maximum(sightings.height - origin, NEAREST_UNITS * unit)
    low, high = np.minimum.outer(height, height), np.maximum.outer(height, height)
    apart_s = np.abs(np.subtract.outer(sightings.time_s, sightings.time_s))
    lean = sightings.by_shift @ sightings.by_shift.T
    in_height = (low * high) ** growth * high.max() ** (2 - 2 * growth) * low / high
    return np.asarray(lean * in_height * np.exp(-apart_s / persistence_s))


class _Fit:
    """Generalised least squares of a straight axis through offsets of a known covariance."""

    def __init__(
        self,
        sightings: AxisSightings,
        covariance_px2: FloatArray,
        prior: tuple[FloatArray, FloatArray],
    ) -> None:
        mean, information = prior
        design = design_matrix(sightings)
        self._residual = sightings.offset_px - design @ mean
        root = np.linalg.cholesky(covariance_px2)
        self._inverse_root = np.linalg.inv(root)
        self._whitened = self._inverse_root @ np.column_stack([design, self._residual])
        normal = self._whitened[:, :4].T @ self._whitened[:, :4] + information
        right = self._whitened[:, :4].T @ self._whitened[:, 4]
        self._gain = np.linalg.solve(normal, self._whitened[:, :4].T)
        misfit = float(self._whitened[:, 4] @ self._whitened[:, 4])
        misfit -= float(right @ np.linalg.solve(normal, right))
        determinants = 2 * np.log(np.diag(root)).sum() + np.linalg.slogdet(normal)[1]
        self.log_likelihood = float(-0.5 * (determinants + misfit))

    def student_weight(self, own_px2: FloatArray, weight: FloatArray) -> FloatArray:
        """(N,) weights, at most 1, by how far each sighting lies from what all others predict."""
        keep = np.eye(len(own_px2)) - self._whitened[:, :4] @ self._gain
        precision = self._inverse_root.T @ keep @ self._inverse_root
        left_out = (precision @ self._residual) / np.diag(precision)
        predicted = 1 / np.diag(precision) - own_px2 / weight
        squared = left_out**2 / (np.maximum(predicted, 0) + own_px2)
        return np.asarray(np.minimum((STUDENT_FREEDOM + 1) / (STUDENT_FREEDOM + squared), 1.0))


def design_matrix(sightings: AxisSightings) -> FloatArray:
    """(N, 4) derivative of the offsets by the axis at the lowest point (x, y) and its slopes."""
    return np.hstack([sightings.by_shift, sightings.height[:, None] * sightings.by_shift])
