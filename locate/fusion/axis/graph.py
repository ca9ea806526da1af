"""The factor graph: camera poses, the plume's sway and its mean axis, with their marginals.

Each sighting is one number, the offset of the axis across itself in one view. It depends on the
mean axis, on the pose of its view and on how the plume swayed at that moment. All three are
variables here; the sway has one value per sighting and a joint prior that ties those near in
time and height together, so views that saw the same sway do not count twice. The offsets are
small, so the graph is linear; `refine_axis` measures them anew about the last solution.
"""

from collections.abc import Sequence

import gtsam
import numpy as np
from gtsam.symbol_shorthand import A, S, X

from geometry.arrays import FloatArray
from geometry.trajectory import Trajectory
from locate.fusion.axis.estimate import AxisEstimate
from locate.fusion.axis.least_squares import design_matrix
from locate.fusion.axis.sightings import AxisSightings
from locate.fusion.axis.sway import Sway, SwayHypothesis, estimate_sway
from locate.fusion.search.columns import PlumeColumn

FALLBACK_ROTATION_RAD = np.deg2rad(0.1)
FALLBACK_RANGE_SHARE = 0.002
"""Standard deviations of a pose that states none: rotation about each axis, and position in
distances from the plume; chosen by hand."""
PLACE_PRIOR_UNITS = 100.0
"""Standard deviation of X and Y before anything is measured, units of fusion: as good as none."""
SLOPE_PRIOR = 0.2
"""Standard deviation of the slopes of a plume before anything is measured; chosen by hand."""
FEWEST_VIEWS = 3
FEWEST_HEIGHTS = 2
FEWEST_SIGHTINGS = 8
"""What an estimate needs at least; chosen by hand (two views and two heights give a line)."""
LEAST_SWAY_PX, LEAST_SWAY_SHARE = 1e-3, 1e-3
"""Standard deviation added to the sway's, px and of its largest, so that its covariance has an
inverse which gtsam's Cholesky factors can hold."""


def estimate_axis(
    trajectory: Trajectory,
    column: PlumeColumn,
    sightings: AxisSightings,
    unit: float,
    *,
    origin: float = 0.0,
    sway: Sway | None = None,
    hypotheses: Sequence[SwayHypothesis] = (),
) -> AxisEstimate | None:
    """Solves for the mean axis from what all views see of it.

    Args:
        trajectory: V poses with their covariances; the camera of the sightings.
        column: The column that was measured.
        sightings: Of its axis.
        unit: Of fusion (`Views.unit`), world units.
        origin: Height of the source above the column's lowest point, where nothing sways.
        sway: That of the sightings where it is known; None estimates it.
        hypotheses: What it is searched for among; see `estimate_sway`.

    Returns:
        The estimate, or None where too few views or heights have a sighting.
    """
    enough = (
        len(sightings) >= FEWEST_SIGHTINGS
        and len(np.unique(sightings.view)) >= FEWEST_VIEWS
        and len(np.unique(sightings.height)) >= FEWEST_HEIGHTS
    )
    if not enough:
        return None
    seen = np.unique(sightings.view)
    poses = {int(i): _pose_covariance(trajectory, int(i), column) for i in seen}
    line = column.line
    upright = -np.array([0, 0, *line[2:]])
    sigmas = np.array([PLACE_PRIOR_UNITS * unit] * 2 + [SLOPE_PRIOR] * 2)
    prior = (upright, np.diag(1 / sigmas**2))
    if sway is None:
        poses_px2 = _pose_covariance_px2(sightings, poses)
        sway = estimate_sway(sightings, origin, unit, poses_px2, prior, hypotheses)
    graph = gtsam.GaussianFactorGraph()
    _add_prior(graph, A(0), upright, np.diag(sigmas**2))
    largest_px = np.sqrt(sway.covariance_px2.diagonal().max())
    least_px = max(LEAST_SWAY_PX, LEAST_SWAY_SHARE * float(largest_px))
    least = least_px**2 * np.eye(len(sightings))
    _add_prior(graph, S(0), np.zeros(len(sightings)), sway.covariance_px2 + least)
    for i, covariance in poses.items():
        _add_prior(graph, X(i), np.zeros(6), covariance)
        rows = np.flatnonzero(sightings.view == i)
        graph.add(
            gtsam.JacobianFactor(
                A(0),
                design_matrix(sightings)[rows],
                X(i),
                sightings.by_pose[rows],
                S(0),
                np.eye(len(sightings))[rows],
                sightings.offset_px[rows],
                gtsam.noiseModel.Diagonal.Sigmas(sway.sigma_px[rows]),
            )
        )
    solution = graph.optimize()
    covariance = gtsam.Marginals(graph, solution).marginalCovariance(A(0))
    return AxisEstimate(
        lowest=float(column.lowest_z),
        line=line + solution.at(A(0)),
        covariance=np.asarray(covariance),
        sway=sway,
    )


def _add_prior(
    graph: gtsam.GaussianFactorGraph, key: int, mean: FloatArray, covariance: FloatArray
) -> None:
    whiten = np.linalg.inv(np.linalg.cholesky(covariance))
    unit_noise = gtsam.noiseModel.Unit.Create(len(mean))
    graph.add(gtsam.JacobianFactor(key, whiten, whiten @ mean, unit_noise))


def _pose_covariance(trajectory: Trajectory, i: int, column: PlumeColumn) -> FloatArray:
    """(6, 6) of world_from_cam; a usual one where the trajectory has none."""
    covariance = None if trajectory.covariances is None else trajectory.covariances[i]
    if covariance is not None and np.isfinite(covariance).all():
        return np.asarray(covariance)
    distance = float(np.linalg.norm(column.lowest_point - trajectory.centers_in_world[i]))
    sigmas = np.repeat([FALLBACK_ROTATION_RAD, FALLBACK_RANGE_SHARE * distance], 3)
    return np.diag(sigmas**2)


def _pose_covariance_px2(sightings: AxisSightings, poses: dict[int, FloatArray]) -> FloatArray:
    """(N, N) covariance of the offsets that the poses' own leaves, px^2."""
    turned = np.stack(
        [poses[int(i)] @ j for i, j in zip(sightings.view, sightings.by_pose, strict=True)]
    )
    same = np.equal.outer(sightings.view, sightings.view)
    return np.asarray(np.where(same, sightings.by_pose @ turned.T, 0.0))
