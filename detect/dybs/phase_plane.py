"""The phases of waves that are drawn on a plane and seen in perspective."""

from dataclasses import dataclass
from typing import Self

import numpy as np

from geometry.arrays import FloatArray
from geometry.normal_errors import MAD_TO_SIGMA

ROUNDS = 6
OUTLIER = 1.0
NORMAL_FROM_MEDIAN = (MAD_TO_SIGMA, 0.8493)
"""Of |error| of one normal component, and of the length of two."""
FLOOR_PX = 1e-3
RIDGE = 1e-9


@dataclass(frozen=True, kw_only=True)
class PhasePlane:
    """Phase q at (x, y) is (a_q + b_q x + c_q y) / (1 + d x + e y), rad.

    Attributes:
        numerators: (Q, 3) a, b, c of each wave.
        denominator: (2,) d, e: one plane, so the same for all.
        scatter_px: Standard deviation of either component of what most points have left.
    """

    numerators: FloatArray
    denominator: FloatArray
    scatter_px: float

    @classmethod
    def fit(
        cls, phases: FloatArray, at: np.ndarray, trust: np.ndarray, px_per_rad: FloatArray
    ) -> Self:
        """The plane of most of the points; what a plume displaces counts little.

        Iteratively reweighted least squares with Cauchy's weights, linear after multiplying by
        the denominator.

        Args:
            phases: (Q, N) rad, unwrapped.
            at: (N, 2) positions, of order 1.
            trust: (Q, N) weights from 0 to 1.
            px_per_rad: (Q,) displacement that turns each wave by one rad.
        """
        count, points = phases.shape
        plain = np.column_stack([np.ones(points), at])
        design = np.zeros((count, points, 3 * count + 2))
        for q in range(count):
            design[q, :, 3 * q : 3 * q + 3] = plain
            design[q, :, -2:] = -at * phases[q, :, None]
        weights = trust
        for _ in range(ROUNDS):
            found = _least_squares(design, phases, weights)
            errors_px = (phases - design @ found) * px_per_rad[:, None]
            sizes = np.sqrt((errors_px**2).sum(axis=0))
            scale = NORMAL_FROM_MEDIAN[count - 1] * np.median(sizes) + FLOOR_PX
            weights = trust / (1 + (sizes / (OUTLIER * scale)) ** 2)
        return cls(
            numerators=found[:-2].reshape(count, 3),
            denominator=found[-2:],
            scatter_px=float(scale),
        )

    def phases(self, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        """(Q, ...) rad at positions that broadcast."""
        rows = [a + b * x + c * y for a, b, c in self.numerators]
        return np.asarray(np.stack(rows) * self._perspective_scale(x, y))

    def slopes(self, x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(Q, ...) change of the phases along x and along y."""
        near, phases = self._perspective_scale(x, y), self.phases(x, y)
        along = [
            (self.numerators[:, i + 1, None, None] - self.denominator[i] * phases) * near
            for i in range(2)
        ]
        return along[0], along[1]

    def _perspective_scale(self, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        d, e = self.denominator
        return np.asarray(1 / (1 + d * x + e * y))


def _least_squares(design: FloatArray, values: FloatArray, weights: FloatArray) -> FloatArray:
    """The solution of weighted (Q, N, P) equations."""
    weighted = (design * weights[..., None]).reshape(-1, design.shape[-1])
    normal = weighted.T @ design.reshape(weighted.shape)
    normal += RIDGE * np.trace(normal) * np.eye(len(normal))
    return np.asarray(np.linalg.solve(normal, weighted.T @ values.ravel()))
