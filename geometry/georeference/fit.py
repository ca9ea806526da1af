"""``target_from_source`` from every source there is, or one line with the reason why not."""

from collections.abc import Sequence

import numpy as np

from geometry.covariance import principal_sigmas, standard_deviations
from geometry.errors import BadInputError
from geometry.georeference.alignment import Alignment, SourceReport
from geometry.georeference.constraints import (
    Constraint,
    PositionConstraint,
    ScaleConstraint,
    UpConstraint,
)
from geometry.georeference.noise import OUTLIER_WEIGHT
from geometry.georeference.solve import SimilarityFit, solve_constraints

CONTRADICTION_SIGMAS = 5.0
"""Mahalanobis distance beyond which a source contradicts the others; chosen."""
MATERIAL_SCALE = 0.02
"""Relative difference of scale below which a contradiction does not matter; chosen."""
MATERIAL_TILT_RAD = float(np.radians(1.0))
"""Difference of the direction of up below which a contradiction does not matter; chosen."""
MAX_ROTATION_SIGMA_RAD = float(np.radians(15.0))
"""Largest standard deviation of a usable rotation, where the linear covariance still holds."""
MAX_SCALE_SIGMA = 0.3
"""Largest relative standard deviation of a usable scale."""


def fit_similarity(constraints: Sequence[Constraint]) -> Alignment:
    """Fits scale, rotation and origin to all constraints at once.

    Positions give all seven parameters, gravity (`UpConstraint`) pins the tilt where they are weak
    in it (a path along a line leaves the roll about it free), `ScaleConstraint` the size. Without
    positions the frame keeps its heading and its origin, and with neither `ScaleConstraint` its
    size.

    Args:
        constraints: From `geometry.georeference.fixes`, `.gravity`, `.lengths` and `.board`.

    Raises:
        BadInputError: Nothing given, too few positions, an answer too weak to be used, or sources
            that contradict each other.
    """
    if not constraints:
        raise BadInputError("nothing is known of the cameras' place: give positions, up or a scale")
    _check_enough(constraints)
    try:
        solution = solve_constraints(constraints)
    except np.linalg.LinAlgError as error:
        raise BadInputError(
            f"{_join_names(constraints)}: leave the pose of the scene free"
        ) from error
    for one in constraints:
        _check_agreement(one, [c for c in constraints if c is not one])
    _check_strength(solution, constraints)
    kinds = {type(c) for c in constraints}
    return Alignment(
        target_from_source=solution.similarity,
        covariance=solution.covariance,
        metric=PositionConstraint in kinds or ScaleConstraint in kinds,
        gravity=PositionConstraint in kinds or UpConstraint in kinds,
        located=PositionConstraint in kinds,
        sources=tuple(_report_source(c, solution) for c in constraints),
    )


def _check_enough(constraints: Sequence[Constraint]) -> None:
    needed = 2 if any(isinstance(c, UpConstraint) for c in constraints) else 3
    for positions in (c for c in constraints if isinstance(c, PositionConstraint)):
        if len(positions) < needed:
            raise BadInputError(
                f"{positions.name}: {len(positions)} positions, at least {needed} are needed"
            )
        spread = np.ptp(positions.points_in_source, axis=0).max()
        if not spread > 1e-9 * max(1.0, float(np.abs(positions.points_in_source).max())):
            raise BadInputError(f"{positions.name}: all positions are of the same point")


def _check_strength(solution: SimilarityFit, constraints: Sequence[Constraint]) -> None:
    """Refuses an answer so weak that its linear covariance means nothing."""
    covariance, names = solution.covariance, _join_names(constraints)
    turn = float(principal_sigmas(covariance[:3, :3])[0])
    if not turn < MAX_ROTATION_SIGMA_RAD:
        cure = (
            "move more sideways"
            if any(isinstance(c, UpConstraint) for c in constraints)
            else "give gravity (gimbal angles, the ground plane) or fly a path with a turn"
        )
        known = f"known only to {np.degrees(turn):.0f} deg" if turn < np.pi / 2 else "not known"
        raise BadInputError(f"{names}: the direction of up and north is {known}; {cure}")
    scale = float(standard_deviations(covariance)[6])
    if not scale < MAX_SCALE_SIGMA:
        raise BadInputError(
            f"{names}: the scale is known only to {100 * scale:.0f} %; "
            "record a longer path or give a known distance"
        )


def _check_agreement(one: Constraint, rest: Sequence[Constraint]) -> None:
    """Compares a direction or a scale with what all the others give."""
    others = [c for c in rest if isinstance(c, (type(one), PositionConstraint))]
    if isinstance(one, PositionConstraint) or not others:
        return
    if isinstance(one, ScaleConstraint):
        others += [c for c in rest if isinstance(c, UpConstraint)]
    try:
        solution = solve_constraints(others)
    except np.linalg.LinAlgError:
        return
    residuals, jacobian = one.residuals(solution.similarity), one.jacobian(solution.similarity)
    expected = np.eye(len(residuals)) + jacobian @ solution.covariance @ jacobian.T
    sigmas = float(np.sqrt(max(float(residuals @ np.linalg.solve(expected, residuals)), 0.0)))
    if sigmas > CONTRADICTION_SIGMAS and _is_material(one, residuals):
        raise BadInputError(
            f"{_describe_contradiction(one, solution)}: {sigmas:.0f} sigma apart; "
            f"one of {one.name} and {_join_names(others)} is wrong, leave it out"
        )


def _is_material(one: UpConstraint | ScaleConstraint, residuals: np.ndarray) -> bool:
    if isinstance(one, ScaleConstraint):
        return bool(abs(residuals[0]) * one.sigma_log > MATERIAL_SCALE)
    return bool(np.linalg.norm(residuals) * one.sigma_rad > MATERIAL_TILT_RAD)


def _describe_contradiction(one: UpConstraint | ScaleConstraint, solution: SimilarityFit) -> str:
    similarity, sigmas = solution.similarity, standard_deviations(solution.covariance)
    if isinstance(one, ScaleConstraint):
        return (
            f"{one.name} gives {one.metres_per_unit:.4g} m per unit (+- {100 * one.sigma_log:.2g} "
            f"%), the rest {similarity.scale:.4g} (+- {100 * sigmas[6]:.2g} %)"
        )
    tilt_deg = np.degrees(np.linalg.norm(one.residuals(similarity)) * one.sigma_rad)
    return (
        f"{one.name} has up {tilt_deg:.1f} deg (+- {np.degrees(one.sigma_rad):.1f}) from "
        f"where the rest has it (+- {np.degrees(sigmas[:2].max()):.1f})"
    )


def _join_names(constraints: Sequence[Constraint]) -> str:
    return ", ".join(c.name for c in constraints)


def _report_source(one: Constraint, solution: SimilarityFit) -> SourceReport:
    if isinstance(one, ScaleConstraint):
        off = float(one.residuals(solution.similarity)[0]) * one.sigma_log
        return SourceReport(
            name=one.name, unit="%", median_residual=100 * abs(off), sigma=100 * one.sigma_log
        )
    if isinstance(one, UpConstraint):
        off = float(np.linalg.norm(one.residuals(solution.similarity))) * one.sigma_rad
        return SourceReport(
            name=one.name,
            unit="deg",
            median_residual=float(np.degrees(off)),
            sigma=float(np.degrees(one.sigma_rad)),
        )
    channels = [c for c in solution.channels if c.positions is one]
    sigmas_m = one.axis_sigmas_m(solution.similarity)
    noises = [c.noise for c in channels if c.noise is not None]
    variances = [
        (noise.level * sigmas_m[:, c.axes]) ** 2 for c, noise in zip(channels, noises, strict=True)
    ]
    weight = np.min([c.fix_weights(solution.similarity) for c in channels], axis=0)
    return SourceReport(
        name=one.name,
        unit="m",
        median_residual=float(
            np.median(np.linalg.norm(one.residuals_m(solution.similarity), axis=1))
        ),
        sigma=float(np.sqrt(np.mean(np.concatenate(variances, axis=1)))),
        count=len(one),
        effective_count=min(noise.effective_count for noise in noises),
        outliers=int((weight < OUTLIER_WEIGHT).sum()),
    )
