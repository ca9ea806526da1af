"""The factor graph: camera poses and the points of a plume's axis, with their marginals.

Each view measures where the axis lies across itself, and nothing along it, so the noise of a
measurement is an ellipse in pixels, tight across the axis. Projection factors take that as it
is; the tangent basis of a bearing factor turns with the prediction and cannot.

Views close in time see the same sway of the plume, and a camera that moves on steadily cannot
tell a slow sway from parallax. What that takes from the number of independent views is judged by
the lag-one correlation of the whole plume, where the sway is largest; at the base the fit has
already swallowed it.
"""

from dataclasses import dataclass

import gtsam
import numpy as np
from gtsam.symbol_shorthand import L, X

from geometry.arrays import FloatArray
from geometry.trajectory import Trajectory
from locate.fusion.axis import AxisSightings
from locate.fusion.column import spine

FALLBACK_ROTATION_RAD = np.deg2rad(0.1)
FALLBACK_RANGE_SHARE = 0.002
ALONG_AXIS_PX = 1e3
HEIGHT_GAUGE_UNITS = 1e-3
NODE_PRIOR_UNITS = 100.0
NOISE_FLOOR_PX = 0.15
STRONGEST_CORRELATION = 0.8
FITTED_PER_NODE = 2
LEAST_FREEDOM = 1.0
WILD_SIGMAS = 3.0
CAUCHY_K = 3.0
FEWEST_VIEWS = 2
FEWEST_SECTIONS = 2
TILT = 0.2


@dataclass(frozen=True, kw_only=True)
class AxisEstimate:
    """The base and the highest point of the axis, and their joint covariance.

    Attributes:
        heights: (2,) of the points above the column's lowest point, along world Z.
        points: (2, 3) in the world.
        covariance: (6, 6) of both, lower first; their heights are fixed by definition.
    """

    heights: FloatArray
    points: FloatArray
    covariance: FloatArray

    def at(self, height: float) -> tuple[FloatArray, FloatArray]:
        """(3,) point of the axis at `height` and its (3, 3) covariance."""
        share = (height - self.heights[0]) / (self.heights[1] - self.heights[0])
        mix = np.hstack([(1 - share) * np.eye(3), share * np.eye(3)])
        return mix @ self.points.ravel(), mix @ self.covariance @ mix.T

    @property
    def rise(self) -> FloatArray:
        """(3,) the way along the axis per unit of height."""
        return np.asarray((self.points[1] - self.points[0]) / np.ptp(self.heights))

    @property
    def direction(self) -> FloatArray:
        """(3,) unit vector of the rise."""
        return np.asarray(self.rise / np.linalg.norm(self.rise))

    @property
    def direction_sigma_rad(self) -> float:
        """Standard deviation of the direction's angle, rad (root mean square over azimuth)."""
        length = np.linalg.norm(self.points[1] - self.points[0])
        difference = np.hstack([-np.eye(3), np.eye(3)])
        across = np.eye(3) - np.outer(self.direction, self.direction)
        spread = across @ difference @ self.covariance @ difference.T @ across
        return float(np.sqrt(np.trace(spread) / 2) / length)


def estimate_axis(
    trajectory: Trajectory, column: FloatArray, sightings: AxisSightings, unit: float
) -> AxisEstimate | None:
    """Solves for the axis from what all views see of it.

    The axis is a chain of points, from the base upwards: a plume leaves its source straight up,
    give or take `TILT` per unit of height, and drifts anew in every section. So what sways high
    up says little about the base, and the lowest section that is seen well says most.

    Args:
        trajectory: V poses with their covariances; the camera of the sightings.
        column: (8,) the column that was sighted.
        sightings: Where each view sees its axis.
        unit: The yardstick of fusion, world units.

    Returns:
        The estimate, or None where fewer than two sections are seen by at least two views.
    """
    measured = np.abs(sightings.normal).sum(axis=-1) > 0
    seen = np.isfinite(sightings.pixel).all(axis=-1) & np.isfinite(sightings.residual_px)
    seen = np.asarray(seen & measured)
    sections = np.flatnonzero(seen.sum(axis=0) >= FEWEST_VIEWS)
    if len(sections) < FEWEST_SECTIONS:
        return None
    graph, initial = gtsam.NonlinearFactorGraph(), gtsam.Values()
    heights = np.r_[0.0, sightings.heights[sections]]
    _add_chain(graph, initial, column, heights, unit)
    for i in np.flatnonzero(seen[:, sections].any(axis=1)):
        _add_pose(graph, initial, trajectory, int(i), sightings.points[0])
    independent = _independent_views(sightings.residual_px)
    freedom = max(independent - FITTED_PER_NODE, LEAST_FREEDOM)
    for node, section in enumerate(sections, start=1):
        rows = np.flatnonzero(seen[:, section])
        sigma = _scatter_px(sightings.residual_px[rows, section]) * np.sqrt(len(rows) / freedom)
        for i in rows:
            _add_sighting(graph, trajectory, sightings, (int(i), node, int(section)), sigma)
    result = gtsam.LevenbergMarquardtOptimizer(graph, initial).optimize()
    ends = (0, len(sections))
    keys = gtsam.KeyVector([L(node) for node in ends])
    joint = gtsam.Marginals(graph, result).jointMarginalCovariance(keys)
    return AxisEstimate(
        heights=heights[list(ends)],
        points=np.array([result.atPoint3(L(node)) for node in ends]),
        covariance=np.asarray(joint.fullMatrix()),
    )


def _scatter_px(offsets: FloatArray) -> float:
    """Sigma of one view's offset, from the scatter over views, the wildest of them reined in."""
    return float(np.hypot(_reined_in(offsets).std(), NOISE_FLOOR_PX))


def _independent_views(residual_px: FloatArray) -> float:
    """How many of the views err independently, by their lag-one correlation where it is real.

    A mean and a trend were taken from few values, which hides correlation: the estimate is
    corrected for that (Kendall, Biometrika 1954).

    Args:
        residual_px: (V, S) of the sections; where the plume sways most counts most.
    """
    seen = residual_px[np.isfinite(residual_px).any(axis=1)]
    n = len(seen)
    centred = np.stack([_reined_in(column) for column in seen.T], axis=1)
    lag = float((centred[1:] * centred[:-1]).sum() / max((centred**2).sum(), 1e-12))
    if lag < 1 / np.sqrt(n):
        return float(n)
    lag = min(lag + (1 + 4 * lag) / n, STRONGEST_CORRELATION)
    return n * (1 - lag) / (1 + lag)


def _reined_in(offsets: FloatArray) -> FloatArray:
    """Centred, the wildest clipped; 0 where there is none."""
    known = offsets[np.isfinite(offsets)]
    if not len(known):
        return np.zeros_like(offsets)
    centred = np.nan_to_num(offsets - np.median(known))
    typical = np.hypot(1.4826 * np.median(np.abs(known - np.median(known))), NOISE_FLOOR_PX)
    return np.asarray(centred.clip(-WILD_SIGMAS * typical, WILD_SIGMAS * typical))


def _add_chain(
    graph: gtsam.NonlinearFactorGraph,
    initial: gtsam.Values,
    column: FloatArray,
    heights: FloatArray,
    unit: float,
) -> None:
    """Points of the axis at the (N,) heights, the base first, each above the one below it."""
    points = spine(column[None], heights[None])[0]
    wide = np.array([NODE_PRIOR_UNITS, NODE_PRIOR_UNITS, HEIGHT_GAUGE_UNITS]) * unit
    graph.add(gtsam.PriorFactorPoint3(L(0), points[0], gtsam.noiseModel.Diagonal.Sigmas(wide)))
    for node, point in enumerate(points):
        initial.insert(L(node), point)
    for node, rise in enumerate(np.diff(heights)):
        sigmas = np.array([TILT * rise, TILT * rise, HEIGHT_GAUGE_UNITS * unit])
        noise = gtsam.noiseModel.Diagonal.Sigmas(sigmas)
        step = np.array([0.0, 0.0, rise])
        graph.add(gtsam.BetweenFactorPoint3(L(node), L(node + 1), step, noise))


def _add_pose(
    graph: gtsam.NonlinearFactorGraph,
    initial: gtsam.Values,
    trajectory: Trajectory,
    i: int,
    target: FloatArray,
) -> None:
    center = trajectory.centers_in_world[i]
    pose = gtsam.Pose3(gtsam.Rot3(trajectory.rotations[i].T), center)
    covariance = None if trajectory.covariances is None else trajectory.covariances[i]
    if covariance is None or not np.isfinite(covariance).all():
        shift = FALLBACK_RANGE_SHARE * float(np.linalg.norm(target - center))
        covariance = np.diag(np.repeat([FALLBACK_ROTATION_RAD, shift], 3) ** 2)
    noise = gtsam.noiseModel.Gaussian.Covariance(covariance)
    graph.add(gtsam.PriorFactorPose3(X(i), pose, noise))
    initial.insert(X(i), pose)


def _add_sighting(
    graph: gtsam.NonlinearFactorGraph,
    trajectory: Trajectory,
    sightings: AxisSightings,
    place: tuple[int, int, int],
    sigma_px: float,
) -> None:
    """Adds what one view saw of one section; `place` is the view, the node and the section."""
    i, node, section = place
    across = sightings.normal[i, section]
    along = np.array([across[1], -across[0]])
    covariance = sigma_px**2 * np.outer(across, across)
    covariance += ALONG_AXIS_PX**2 * np.outer(along, along)
    noise = gtsam.noiseModel.Robust.Create(
        gtsam.noiseModel.mEstimator.Cauchy.Create(CAUCHY_K),
        gtsam.noiseModel.Gaussian.Covariance(covariance),
    )
    K = trajectory.camera.matrix
    calibration = gtsam.Cal3_S2(K[0, 0], K[1, 1], 0.0, K[0, 2], K[1, 2])
    pixel = sightings.pixel[i, section]
    graph.add(gtsam.GenericProjectionFactorCal3_S2(pixel, noise, X(i), L(node), calibration))
