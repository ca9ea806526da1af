"""Standard deviations of covariances, whatever rounding did to these."""

import numpy as np

from geometry.arrays import FloatArray

LOST_IN_ROUNDING = 1e-12
"""Eigenvalues smaller than this share of the largest are rounding; double precision has 2e-16."""


def standard_deviations(covariance: FloatArray) -> FloatArray:
    """(..., N) square roots of the diagonals of (..., N, N) covariances; 0 for a negative one."""
    variances = np.diagonal(covariance, axis1=-2, axis2=-1)
    return np.asarray(np.sqrt(np.maximum(variances, 0.0)))


def principal_sigmas(covariance: FloatArray) -> FloatArray:
    """(N,) standard deviations of an (N, N) covariance along its axes, largest first."""
    variances = np.linalg.eigvalsh(covariance)[::-1]
    return np.asarray(np.sqrt(np.maximum(variances, 0.0)))


def sigma_along(covariance: FloatArray, direction: FloatArray) -> float:
    """Standard deviation of an (N, N) covariance along an (N,) unit vector."""
    return float(np.sqrt(max(float(direction @ covariance @ direction), 0.0)))


def split_information(information: FloatArray) -> tuple[FloatArray, FloatArray]:
    """The inverse of an information matrix along what it determines, and what it leaves free.

    A direction whose eigenvalue is lost in rounding is left out of the inverse, whichever sign
    rounding gave it. The matrix is scaled to a unit diagonal first, so that units do not matter.

    Args:
        information: (K, K), symmetric, positive semidefinite but for rounding.

    Returns:
        (K, K) inverse, and (K, F) columns that span the F free directions.
    """
    scale = np.sqrt(np.maximum(np.diagonal(information), 0.0))
    scale = np.where(scale > 0, scale, 1.0)
    values, vectors = np.linalg.eigh(information / np.outer(scale, scale))
    kept = values > LOST_IN_ROUNDING * values[-1]
    directions = vectors / scale[:, None]
    inverse = directions[:, kept] / values[kept] @ directions[:, kept].T
    return np.asarray(inverse), np.asarray(directions[:, ~kept])
