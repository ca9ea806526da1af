"""The result of a georeferencing: a similarity with its covariance, and a report per source."""

from dataclasses import dataclass
from typing import Any, Self

import numpy as np
from scipy.spatial.transform import Rotation

from geometry.arrays import FloatArray
from geometry.covariance import principal_sigmas, standard_deviations
from geometry.errors import BadInputError
from geometry.georeference.constraints import TANGENT, direction_jacobian, point_jacobian
from geometry.json_values import as_number, as_numbers, check_fields
from geometry.quaternions import rotation_of
from geometry.similarity import Similarity

KNOWN = ("metric", "gravity", "located")


@dataclass(frozen=True, kw_only=True)
class SourceReport:
    """What became of one source.

    Attributes:
        name: Of the source.
        unit: ``"m"``, ``"deg"`` or ``"%"``, of the next two.
        median_residual: Median length of its residuals.
        sigma: What the fit took for one sigma of it (of one axis where it has several).
        count: Number of fixes; 1 for the others.
        effective_count: Number of independent fixes with the same information.
        outliers: Fixes that were given less than a quarter of the usual weight.
    """

    name: str
    unit: str
    median_residual: float
    sigma: float
    count: int = 1
    effective_count: float = 1.0
    outliers: int = 0


@dataclass(frozen=True, kw_only=True)
class Alignment:
    """``target_from_source`` with its uncertainty.

    Attributes:
        target_from_source: To local east-north-up, or to as much of it as is known.
        covariance: (7, 7) in the left tangent of `geometry.georeference.constraints`: [rotation
            (rad), translation (m), log scale]. Zero where the frame is free to choose: without
            positions there is no north and no origin to be wrong about.
        metric: The scale is known.
        gravity: Up is known.
        located: The position on the Earth is known.
        sources: What became of each source.
    """

    target_from_source: Similarity
    covariance: FloatArray
    metric: bool
    gravity: bool
    located: bool
    sources: tuple[SourceReport, ...]

    @property
    def scale_sigma(self) -> float:
        """Relative standard deviation of the scale."""
        return float(standard_deviations(self.covariance)[6])

    @property
    def tilt_sigma_rad(self) -> float:
        """Standard deviation of the direction of up about its worse axis."""
        return float(principal_sigmas(self.covariance[:2, :2])[0])

    def position_covariances(self, points_in_target: FloatArray) -> FloatArray:
        """(N, 3, 3) that the transform adds to (N, 3) target points, J C J^T, m squared."""
        jacobian = point_jacobian(np.reshape(points_in_target, (-1, 3)))
        return np.asarray(jacobian @ self.covariance @ jacobian.swapaxes(1, 2))

    def direction_sigma_rad(self, direction_in_target: FloatArray) -> float:
        """What the transform adds to the sigma of a unit direction, mean of its two axes."""
        jacobian = direction_jacobian(direction_in_target)
        variance = np.trace(jacobian @ self.covariance @ jacobian.T) / 2
        return float(np.sqrt(max(variance, 0.0)))

    def to_dict(self) -> dict[str, Any]:
        """The keys of the ``georeference`` block of map.json that hold the fit."""
        similarity = self.target_from_source
        return {
            "enu_from_scene": {
                "scale": similarity.scale,
                "rotation_xyzw": Rotation.from_matrix(similarity.rotation).as_quat().tolist(),
                "translation": similarity.translation.tolist(),
            },
            "covariance": self.covariance.tolist(),
            "covariance_order": list(TANGENT),
            "sources": [vars(source) for source in self.sources],
            "known": [name for name in KNOWN if getattr(self, name)],
        }

    @classmethod
    def from_dict(cls, block: dict[str, Any]) -> Self:
        """Reads what `to_dict` made.

        Raises:
            BadInputError: A key is missing or has the wrong shape.
        """
        try:
            similarity = block["enu_from_scene"]
            quaternion = as_numbers(similarity["rotation_xyzw"], "rotation_xyzw")
            return cls(
                target_from_source=Similarity(
                    scale=as_number(similarity["scale"], "scale"),
                    rotation=rotation_of(quaternion).as_matrix(),
                    translation=as_numbers(similarity["translation"], "translation").reshape(3),
                ),
                covariance=as_numbers(block["covariance"], "covariance").reshape(7, 7),
                sources=tuple(check_fields(SourceReport, source) for source in block["sources"]),
                **{name: name in block["known"] for name in KNOWN},
            )
        except (KeyError, TypeError, ValueError) as error:
            raise BadInputError(f"georeference lacks a valid {error}") from error
