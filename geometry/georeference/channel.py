"""The horizontal or the vertical part of a set of positions, with its own noise."""

from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from geometry.arrays import FloatArray
from geometry.georeference.constraints import PositionConstraint
from geometry.georeference.noise import (
    MIN_FREE,
    PositionNoise,
    bisquare_curvatures,
    bisquare_residuals,
    bisquare_weights,
    estimate_noise,
)
from geometry.similarity import Similarity

HORIZONTAL, VERTICAL = slice(0, 2), slice(2, 3)
CHI_SQUARE_MEDIAN = {2: 1.386, 1: 0.455}
"""Median of the chi-square distribution by its degrees of freedom."""


@dataclass(frozen=True, kw_only=True)
class PositionChannel:
    """East and north of a set of positions, or up: receivers are worse at one than the other.

    Attributes:
        positions: The set.
        axes: `HORIZONTAL` or `VERTICAL`.
        level: The noise of its better half, in units of the stated sigmas.
        noise: The noise with its correlation; None before the fit has ended.
    """

    positions: PositionConstraint
    axes: slice
    level: float = 1.0
    noise: PositionNoise | None = None

    @property
    def axis_count(self) -> int:
        """Number of axes."""
        return int(self.axes.stop - self.axes.start)

    def with_level(self, similarity: Similarity, lost: float) -> Self:
        """With the level estimated from the residuals; at least the stated one where they are few.

        Args:
            similarity: The current estimate.
            lost: Degrees of freedom that the fit takes, in fixes.
        """
        n = len(self.positions)
        squared = (self._whitened_residuals(similarity, similarity) ** 2).sum(axis=1)
        median = float(np.median(squared)) / CHI_SQUARE_MEDIAN[self.axis_count]
        if self.axis_count * (n - lost) < MIN_FREE:
            return replace(self, level=max(float(np.sqrt(median)), 1.0))
        return replace(self, level=max(float(np.sqrt(median * n / (n - lost))), 1e-6))

    def robust_residuals(self, around: Similarity, at: Similarity) -> FloatArray:
        """(N * D,) at `at`, in units of the level, the sigmas taken `around`."""
        return bisquare_residuals(self._whitened_residuals(around, at) / self.level).ravel()

    def fix_weights(self, similarity: Similarity) -> FloatArray:
        """(N,) between 0 and 1."""
        return bisquare_weights(self._squared_lengths(similarity), self.axis_count)

    def with_noise(self, similarity: Similarity, free: FloatArray) -> Self:
        """With the noise of the residuals at the solution."""
        times_s = self.positions.times_s
        if times_s is None:
            times_s = np.arange(len(self.positions), dtype=float)
        noise = estimate_noise(
            self._whitened_residuals(similarity, similarity),
            self._whitened_jacobian(similarity, free),
            self.fix_weights(similarity),
            times_s,
            fallback=self.level,
        )
        return replace(self, noise=noise)

    def information_and_slope(
        self, similarity: Similarity, free: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """(K, K) curvature of the cost and (K, K) covariance of its slope."""
        assert self.noise is not None
        squared = self._squared_lengths(similarity)
        root = np.sqrt(bisquare_weights(squared, self.axis_count))[:, None, None]
        slopes = root * self._whitened_jacobian(similarity, free)
        rows = slopes.reshape(-1, free.shape[1])
        bend = (
            bisquare_curvatures(squared, self.axis_count).sum()
            / bisquare_weights(squared, self.axis_count).sum()
        )
        pairs = np.einsum("iak,ij,jal->kl", slopes, self.noise.covariance, slopes, optimize=True)
        return bend / self.level**2 * (rows.T @ rows), pairs / self.level**4

    def _whitened_residuals(self, around: Similarity, at: Similarity) -> FloatArray:
        residuals_m = self.positions.residuals_m(at)
        return np.asarray((residuals_m / self.positions.axis_sigmas_m(around))[:, self.axes])

    def _squared_lengths(self, similarity: Similarity) -> FloatArray:
        residuals = self._whitened_residuals(similarity, similarity) / self.level
        return np.asarray((residuals**2).sum(axis=1))

    def _whitened_jacobian(self, similarity: Similarity, free: FloatArray) -> FloatArray:
        """(N, D, K) derivatives of the whitened residuals."""
        sigmas_m = self.positions.axis_sigmas_m(similarity)[:, self.axes, None]
        return np.asarray(self.positions.jacobian(similarity)[:, self.axes] @ free / sigmas_m)
