"""One least-squares over all that is known of ``target_from_source``."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares

from geometry.arrays import FloatArray
from geometry.covariance import split_information
from geometry.georeference.channel import HORIZONTAL, VERTICAL, PositionChannel
from geometry.georeference.constraints import (
    Constraint,
    PositionConstraint,
    ScaleConstraint,
    UpConstraint,
    apply_tangent,
)
from geometry.georeference.start import align_by_least_median, rotation_to_upright
from geometry.similarity import Similarity

MAX_ROUNDS = 30
"""Most rounds of reweighting."""
CONVERGED = 1e-3
"""Change of a step, and relative change of a noise level, at which the rounds end."""
UNKNOWN_VARIANCE = 1e12
"""Along what the constraints leave free, in variances of one fix; any huge number will do."""


@dataclass(frozen=True, kw_only=True)
class SimilarityFit:
    """The similarity that fits all constraints best.

    Attributes:
        similarity: ``target_from_source``.
        covariance: (7, 7), zero along what no constraint determines.
        channels: Two of every set of positions.
    """

    similarity: Similarity
    covariance: FloatArray
    channels: tuple[PositionChannel, ...]


def solve_constraints(constraints: Sequence[Constraint]) -> SimilarityFit:
    """Bisquare least squares with the noise level of every channel taken from its residuals.

    Raises:
        LinAlgError: The constraints leave free what they should determine.
    """
    positions = [c for c in constraints if isinstance(c, PositionConstraint)]
    others = [c for c in constraints if not isinstance(c, PositionConstraint)]
    free, similarity = _free_directions(constraints), first_guess(constraints)
    lost = free.shape[1] / 3
    channels = [
        PositionChannel(positions=p, axes=axes).with_level(similarity, lost)
        for p in positions
        for axes in (HORIZONTAL, VERTICAL)
    ]
    for _ in range(MAX_ROUNDS):
        step = _solve_step(similarity, free, channels, others)
        similarity = apply_tangent(similarity, step)
        before = [channel.level for channel in channels]
        channels = [channel.with_level(similarity, lost) for channel in channels]
        settled = np.allclose(before, [c.level for c in channels], rtol=CONVERGED)
        if settled and np.abs(step).max() < CONVERGED:
            break
    channels = [channel.with_noise(similarity, free) for channel in channels]
    covariance = _sandwich_covariance(similarity, free, channels, others)
    return SimilarityFit(similarity=similarity, covariance=covariance, channels=tuple(channels))


def first_guess(constraints: Sequence[Constraint]) -> Similarity:
    """Where to start: from the largest set of positions, else only upright and to scale."""
    positions = [c for c in constraints if isinstance(c, PositionConstraint)]
    ups = [c for c in constraints if isinstance(c, UpConstraint)]
    up = min(ups, key=lambda c: c.sigma_rad).up_in_source if ups else None
    if positions:
        largest = max(positions, key=len)
        return align_by_least_median(largest.points_in_source, largest.positions_in_target, up)
    scales = [c.metres_per_unit for c in constraints if isinstance(c, ScaleConstraint)]
    return Similarity(
        scale=scales[0] if scales else 1.0,
        rotation=np.eye(3) if up is None else rotation_to_upright(up),
        translation=np.zeros(3),
    )


def _free_directions(constraints: Sequence[Constraint]) -> FloatArray:
    """(7, K) columns of the tangent that the constraints determine."""
    kinds = {type(c) for c in constraints}
    located = PositionConstraint in kinds
    tilt, scale = located or UpConstraint in kinds, located or ScaleConstraint in kinds
    return np.eye(7)[:, [tilt, tilt, located, located, located, located, scale]]


def _solve_step(
    similarity: Similarity,
    free: FloatArray,
    channels: Sequence[PositionChannel],
    others: Sequence[UpConstraint | ScaleConstraint],
) -> FloatArray:
    """(7,) in the tangent from `similarity` to the best one under the levels of the channels."""

    def residuals(step: FloatArray) -> FloatArray:
        at = apply_tangent(similarity, free @ step)
        rows = [channel.robust_residuals(similarity, at) for channel in channels]
        return np.concatenate([*rows, *(other.residuals(at) for other in others)])

    found = least_squares(residuals, np.zeros(free.shape[1]), method="lm", x_scale="jac")
    return np.asarray(free @ found.x)


def _sandwich_covariance(
    similarity: Similarity,
    free: FloatArray,
    channels: Sequence[PositionChannel],
    others: Sequence[UpConstraint | ScaleConstraint],
) -> FloatArray:
    """A^-1 B A^-1 with A the curvature of the cost and B the covariance of its slope."""
    terms = [channel.information_and_slope(similarity, free) for channel in channels]
    for other in others:
        jacobian = other.jacobian(similarity) @ free
        terms.append((jacobian.T @ jacobian, jacobian.T @ jacobian))
    inverse, unknown = split_information(np.sum([term[0] for term in terms], axis=0))
    spread = inverse @ np.sum([term[1] for term in terms], axis=0) @ inverse
    spread += UNKNOWN_VARIANCE * unknown @ unknown.T
    covariance = free @ spread @ free.T
    shared = [c.positions.shared_sigma_m for c in channels if c.axes == HORIZONTAL]
    covariance[3:6, 3:6] += np.diag(np.square(np.reshape(shared, (-1, 3))).sum(axis=0))
    if not np.isfinite(covariance).all():
        raise np.linalg.LinAlgError("no finite covariance")
    return np.asarray(covariance)
