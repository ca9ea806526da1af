"""What one source measures of ``target_from_source``, with its uncertainty.

The target is local east-north-up (z up, metres), the source the frame of the cameras. A small
change of the transform is written in the left tangent, in the target frame: [rotation omega (rad),
translation tau (m), log scale lambda], which moves a target point x to
``exp(lambda) Exp(omega) x + tau``. To first order a point moves by ``[-[x]x | I | x]`` and a
direction by ``[-[u]x | 0 | 0]`` times the tangent.
"""

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from geometry.arrays import FloatArray
from geometry.errors import BadInputError
from geometry.sfm.covariance import skew_matrices
from geometry.similarity import Similarity

TANGENT = ("rotation_rad", "translation_m", "log_scale")
"""Order of the tangent, as files name it."""


@dataclass(frozen=True, kw_only=True)
class PositionConstraint:
    """Known positions of points of the source frame: fixes of the camera, surveyed points.

    Attributes:
        name: Of the source, for people.
        points_in_source: (N, 3), camera centres or others.
        positions_in_target: (N, 3) in m.
        sigmas_m: (N, 3) of `positions_in_target`. Only their ratios count where there are fixes
            enough to see the noise: its level is then taken from the residuals.
        covariances_in_source: (N, 3, 3) of the points.
        times_s: (N,) to see noise that is correlated in time; the order of the fixes otherwise.
        shared_sigma_m: (3,) of an error common to all fixes, which no residual shows.
    """

    name: str
    points_in_source: FloatArray
    positions_in_target: FloatArray
    sigmas_m: FloatArray
    covariances_in_source: FloatArray | None = None
    times_s: FloatArray | None = None
    shared_sigma_m: tuple[float, float, float] = (0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        n = len(self.points_in_source)
        for name in ("points_in_source", "positions_in_target", "sigmas_m"):
            array = getattr(self, name)
            if array.shape != (n, 3):
                raise ValueError(f"{name}.shape={array.shape}, expected ({n}, 3)")
            if not np.isfinite(array).all():
                raise BadInputError(f"{self.name}: a position or its sigma is not a finite number")
        if (self.sigmas_m <= 0).any():
            raise BadInputError(f"{self.name}: a sigma is not positive")

    def __len__(self) -> int:
        return len(self.points_in_source)

    def residuals_m(self, target_from_source: Similarity) -> FloatArray:
        """(N, 3) of transformed points minus positions."""
        return target_from_source(self.points_in_source) - self.positions_in_target

    def axis_sigmas_m(self, target_from_source: Similarity) -> FloatArray:
        """(N, 3) standard deviations of the residuals; correlation between axes is left out."""
        variances = self.sigmas_m**2
        if self.covariances_in_source is not None:
            own = target_from_source.transform_covariance(self.covariances_in_source)
            variances = variances + np.diagonal(own, axis1=1, axis2=2)
        return np.asarray(np.sqrt(variances))

    def jacobian(self, target_from_source: Similarity) -> FloatArray:
        """(N, 3, 7) of `residuals_m` by the tangent."""
        return point_jacobian(target_from_source(self.points_in_source))


@dataclass(frozen=True, kw_only=True)
class UpConstraint:
    """The direction of up in the source frame.

    Attributes:
        name: Of the source, for people.
        up_in_source: (3,) unit vector.
        sigma_rad: Standard deviation about each of two axes.
    """

    name: str
    up_in_source: FloatArray
    sigma_rad: float

    def residuals(self, target_from_source: Similarity) -> FloatArray:
        """(2,) horizontal part of the turned vector over sigma."""
        turned: FloatArray = target_from_source.rotation @ self.up_in_source
        # Behind the horizon the horizontal part shrinks again: the whole tilt must not.
        tilt = np.arctan2(np.linalg.norm(turned[:2]), turned[2])
        level = turned[:2] / max(float(np.linalg.norm(turned[:2])), 1e-12)
        return np.asarray(level * tilt / self.sigma_rad)

    def jacobian(self, target_from_source: Similarity) -> FloatArray:
        """(2, 7) of `residuals` by the tangent, where they are small."""
        return direction_jacobian(target_from_source.rotation @ self.up_in_source)[:2] / (
            self.sigma_rad
        )


@dataclass(frozen=True, kw_only=True)
class ScaleConstraint:
    """Metres per unit of the source frame.

    Attributes:
        name: Of the source, for people.
        metres_per_unit: Positive.
        sigma_log: Standard deviation of its logarithm, which is the relative one.
    """

    name: str
    metres_per_unit: float
    sigma_log: float

    def __post_init__(self) -> None:
        if not (np.isfinite(self.metres_per_unit) and self.metres_per_unit > 0):
            raise BadInputError(f"{self.name}: gives a scale of {self.metres_per_unit:.3g} m")
        if not (np.isfinite(self.sigma_log) and self.sigma_log > 0):
            raise BadInputError(f"{self.name}: gives a scale without an uncertainty")

    def residuals(self, target_from_source: Similarity) -> FloatArray:
        """(1,) difference of the logarithms over sigma."""
        return np.array([np.log(target_from_source.scale / self.metres_per_unit) / self.sigma_log])

    def jacobian(self, _: Similarity) -> FloatArray:
        """(1, 7) of `residuals` by the tangent."""
        return np.array([[0, 0, 0, 0, 0, 0, 1 / self.sigma_log]])


Constraint = PositionConstraint | UpConstraint | ScaleConstraint


def apply_tangent(similarity: Similarity, tangent: FloatArray) -> Similarity:
    """The similarity after a (7,) step in the left tangent."""
    turn, growth = Rotation.from_rotvec(tangent[:3]).as_matrix(), float(np.exp(tangent[6]))
    return Similarity(
        scale=growth * similarity.scale,
        rotation=turn @ similarity.rotation,
        translation=growth * turn @ similarity.translation + tangent[3:6],
    )


def point_jacobian(points_in_target: FloatArray) -> FloatArray:
    """(N, 3, 7) derivative of (N, 3) target points by the left tangent."""
    n = len(points_in_target)
    return np.concatenate(
        [
            -skew_matrices(points_in_target),
            np.tile(np.eye(3), (n, 1, 1)),
            points_in_target[:, :, None],
        ],
        axis=2,
    )


def direction_jacobian(direction_in_target: FloatArray) -> FloatArray:
    """(3, 7) derivative of a target direction by the left tangent."""
    return np.concatenate([-skew_matrices(direction_in_target[None])[0], np.zeros((3, 4))], axis=1)
