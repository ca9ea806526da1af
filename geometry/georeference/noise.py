"""How noisy known positions are, and how much of the noise they share with their neighbours.

Fixes of a receiver err together for seconds to minutes, and at times by tens of metres. The fit
is an MM-estimate (Yohai, Annals of Statistics 1987): it starts where half of the fixes agree, takes
the noise from their median, and gives no weight at all to what lies far beyond it. Its covariance
is Huber's for M-estimates (Robust Statistics, 1981, section 7.6), with the correlation of the
errors in time in place of independence.
"""

from dataclasses import dataclass

import numpy as np
from scipy.linalg import cho_factor, cho_solve, null_space

from geometry.arrays import FloatArray

REACH = {1: 4.685, 2: 5.12}  # of the bisquare, 95 % efficient under Gaussian noise
OUTLIER_WEIGHT = 0.25
"""Bisquare weight below which a fix counts as an outlier; chosen."""
MIN_FREE = 5
"""Fewest degrees of freedom from which a noise level is estimated; chosen."""
TIME_CONSTANTS = 6
"""Number of correlation times in the grid."""
LONGEST_SHARE = 0.5
"""Longest correlation time of the grid, over the length of the record."""
SHARES = (0.7, 1.0)
"""Shares of the noise that is correlated in time, in the grid."""
INDEPENDENT_PRIOR = 0.8
"""Prior probability that the errors of the fixes are independent; chosen."""


def bisquare_weights(squared: FloatArray, dims: int) -> FloatArray:
    """(N,) bisquare weights of squared residual lengths in units of the noise."""
    return np.asarray(np.maximum(1 - squared / REACH[dims] ** 2, 0.0) ** 2)


def bisquare_curvatures(squared: FloatArray, dims: int) -> FloatArray:
    """(N,) second derivatives of the bisquare, mean of the `dims` directions."""
    inside = np.maximum(1 - squared / REACH[dims] ** 2, 0.0)
    return np.asarray(inside**2 - 4 / dims * squared / REACH[dims] ** 2 * inside)


def bisquare_residuals(residuals: FloatArray) -> FloatArray:
    """(N, D) residuals shrunk so that their squares sum to twice the bisquare cost."""
    dims = residuals.shape[1]
    share = (residuals**2).sum(axis=1, keepdims=True) / REACH[dims] ** 2
    cost = (1 - np.maximum(1 - share, 0.0) ** 3) / 3
    shrink = np.where(share > 1e-9, cost / np.maximum(share, 1e-9), 1.0)
    return np.asarray(residuals * np.sqrt(shrink))


@dataclass(frozen=True, kw_only=True)
class PositionNoise:
    """The noise of one channel (horizontal or vertical) of a set of fixes.

    Attributes:
        level: Its standard deviation in units of the stated sigmas.
        covariance: (N, N) of the weighted residuals of any one axis, in the same units squared.
        effective_count: Number of independent fixes whose mean would be as good.
    """

    level: float
    covariance: FloatArray
    effective_count: float


def estimate_noise(
    residuals: FloatArray,
    jacobian: FloatArray,
    weight: FloatArray,
    times_s: FloatArray,
    *,
    fallback: float,
) -> PositionNoise:
    """Level and correlation in time by restricted maximum likelihood.

    The correlation is ``(1 - q) I + q exp(-dt / tau)``, and the answer the mean over a grid of
    (q, tau), each with the likelihood of the residuals after the fit took its part of them
    (Patterson and Thompson, Biometrika 1971). Independence has 0.8 of the prior, and each tau a
    share of the rest in proportion to 1 / tau. Fixes without weight take no part.

    Args:
        residuals: (N, D) in units of the stated sigmas.
        jacobian: (N, D, K) of `residuals` by what was fitted.
        weight: (N,) of the fit.
        times_s: (N,).
        fallback: The level where the residuals are too few to show it.
    """
    correlations, prior = _candidate_correlations(times_s)
    n, dims = residuals.shape
    used = weight > OUTLIER_WEIGHT
    root = np.sqrt(weight[used])[:, None]
    kept = null_space((jacobian[used] * root[:, :, None]).reshape(used.sum() * dims, -1).T)
    free = kept.shape[1]
    if free < MIN_FREE:
        return PositionNoise(
            level=fallback, covariance=fallback**2 * np.eye(n), effective_count=float(n)
        )
    seen = kept.T @ (residuals[used] * root).ravel()
    logs, variances = np.log(prior), np.zeros(len(prior))
    for i, correlation in enumerate(correlations):
        among = np.kron(correlation[np.ix_(used, used)], np.eye(dims))
        factor = cho_factor(kept.T @ among @ kept, lower=True)
        variances[i] = float(seen @ cho_solve(factor, seen)) / free
        logs[i] -= np.log(np.diag(factor[0])).sum() + 0.5 * free * np.log(variances[i] + 1e-300)
    likelihood = np.exp(logs - logs.max())
    shares = likelihood / likelihood.sum() * variances
    mixed = np.einsum("m,mij->ij", shares, np.array(correlations))
    total = mixed.sum()  # 0 where the fixes fit exactly
    effective = n * np.trace(mixed) / total if total > 0 else n
    return PositionNoise(
        level=float(np.sqrt(shares.sum())),
        covariance=mixed,
        effective_count=float(min(effective, n)),
    )


def _candidate_correlations(times_s: FloatArray) -> tuple[list[FloatArray], FloatArray]:
    """Independence and a grid from the spacing of the fixes to half the record, with the prior."""
    gaps = np.abs(times_s[:, None] - times_s[None, :])
    spacing, longest = float(np.median(np.diff(np.sort(times_s)))), LONGEST_SHARE * gaps.max()
    independent = np.eye(len(times_s))
    if not 0 < spacing < longest:
        return [independent], np.ones(1)
    constants = np.geomspace(spacing, longest, TIME_CONSTANTS)
    mixed = [
        (1 - share) * independent + share * np.exp(-gaps / constant)
        for constant in constants
        for share in SHARES
    ]
    correlated = np.repeat(1 / constants, len(SHARES))
    correlated *= (1 - INDEPENDENT_PRIOR) / correlated.sum()
    return [independent, *mixed], np.concatenate([[INDEPENDENT_PRIOR], correlated])
