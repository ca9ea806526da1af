"""A straight axis fitted to the sightings of it, whose errors have a known covariance."""

import numpy as np
from scipy.linalg import solve_triangular

from geometry.arrays import FloatArray
from locate.fusion.axis.sightings import AxisSightings

STUDENT_FREEDOM = 4.0
"""Degrees of freedom of Student's distribution, for outliers; the usual choice."""


class AxisFit:
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
        self._root = np.linalg.cholesky(covariance_px2)
        self._whitened = self._whiten(np.column_stack([design, self._residual]))
        normal = self._whitened[:, :4].T @ self._whitened[:, :4] + information
        right = self._whitened[:, :4].T @ self._whitened[:, 4]
        self._normal = normal
        misfit = float(self._whitened[:, 4] @ self._whitened[:, 4])
        misfit -= float(right @ np.linalg.solve(normal, right))
        determinants = 2 * np.log(np.diag(self._root)).sum() + np.linalg.slogdet(normal)[1]
        self.log_likelihood = float(-0.5 * (determinants + misfit))

    def _whiten(self, columns: FloatArray) -> FloatArray:
        return np.asarray(solve_triangular(self._root, columns, lower=True, check_finite=False))

    def student_weights(self, own_px2: FloatArray, weight: FloatArray) -> FloatArray:
        """(N,) weights, at most 1, by how far each sighting lies from what all others predict."""
        gain = np.linalg.solve(self._normal, self._whitened[:, :4].T)
        inverse_root = self._whiten(np.eye(len(own_px2)))
        keep = np.eye(len(own_px2)) - self._whitened[:, :4] @ gain
        precision = inverse_root.T @ keep @ inverse_root
        left_out = (precision @ self._residual) / np.diag(precision)
        predicted = 1 / np.diag(precision) - own_px2 / weight
        squared = left_out**2 / (np.maximum(predicted, 0) + own_px2)
        return np.asarray(np.minimum((STUDENT_FREEDOM + 1) / (STUDENT_FREEDOM + squared), 1.0))


def design_matrix(sightings: AxisSightings) -> FloatArray:
    """(N, 4) derivative of the offsets by the axis at the lowest point (x, y) and its slopes."""
    return np.hstack([sightings.by_shift, sightings.height[:, None] * sightings.by_shift])
