"""How often a column is present, from how often its place was covered and it was seen."""

from collections.abc import Sequence

import numpy as np
from scipy.special import betaln, logsumexp
from scipy.stats import beta

from geometry.arrays import FloatArray
from locate.survey.findings import OccurrenceCount

ALL = "all"
PRIOR_FLIGHTS = 1.0
"""Weight of a cell's prior, in flights; chosen."""
INTERVAL = (0.05, 0.95)
"""Quantiles that are stated."""
STEPS = 2000
"""Of the numeric integral over a probability."""


def pooled_prior(covered: FloatArray, seen: FloatArray) -> tuple[float, float]:
    """Mean and weight (in flights) of the Beta prior of one cell: the survey's own share.

    An empirical prior: most of the ground sends up nothing; the share that does is that of the
    survey. Half a sighting in one flight is added so that it is neither 0 nor 1.
    """
    return float((seen.sum() + 0.5) / (covered.sum() + 1.0)), PRIOR_FLIGHTS


Prior = tuple[float | FloatArray, float]


def beta_posterior(
    covered: FloatArray, seen: FloatArray, prior: Prior
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Mean, 5 % and 95 % quantile of Beta posteriors; NaN where nothing was covered.

    Args:
        covered: How often each was covered.
        seen: How often it was seen, at most `covered`.
        prior: Mean and weight in flights.
    """
    a, b = _beta_parameters(covered, seen, prior)
    low, high = (np.where(covered > 0, beta.ppf(q, a, b), np.nan) for q in INTERVAL)
    return posterior_mean(covered, seen, prior), low, high


def posterior_mean(covered: FloatArray, seen: FloatArray, prior: Prior) -> FloatArray:
    """The first of `beta_posterior`."""
    a, b = _beta_parameters(covered, seen, prior)
    return np.where(covered > 0, a / (a + b), np.nan)


def _beta_parameters(
    covered: FloatArray, seen: FloatArray, prior: Prior
) -> tuple[FloatArray, FloatArray]:
    mean, weight = prior
    return mean * weight + seen, (1 - np.asarray(mean)) * weight + covered - seen


def hotspot_counts(covered: Sequence[str], seen: Sequence[str]) -> tuple[OccurrenceCount, ...]:
    """How often a hotspot was present: in all, then in each bin that holds a covering flight.

    Args:
        covered: The bin of every flight that covered it, those that saw it included.
        seen: The bin of every flight that saw it.
    """
    groups = [ALL, *dict.fromkeys(covered)]
    counts = []
    for name in groups:
        n = len(covered) if name == ALL else covered.count(name)
        k = len(seen) if name == ALL else seen.count(name)
        mean, low, high = hotspot_posterior(n, k, known_by_sight=name == ALL)
        counts.append(
            OccurrenceCount(bin=name, looked=n, seen=k, probability=mean, low=low, high=high)
        )
    return tuple(counts)


def hotspot_posterior(n: int, k: int, *, known_by_sight: bool) -> tuple[float, float, float]:
    """Mean, 5 % and 95 % quantile of how often a hotspot that was found is there.

    It is known only because it was seen at least once: the likelihood is a binomial without its
    zero, ``p^k (1 - p)^(n - k) / (1 - (1 - p)^n)``; the prior is flat.

    Args:
        n: Number of flights that covered its place.
        k: Number of times it was seen.
        known_by_sight: These flights are all there were, so that k = 0 cannot be.
    """
    p = (np.arange(STEPS) + 0.5) / STEPS
    log_likelihood = k * np.log(p) + (n - k) * np.log1p(-p) - betaln(k + 1, n - k + 1)
    if known_by_sight:
        log_likelihood -= np.log(-np.expm1(n * np.log1p(-p)))
    share = np.exp(log_likelihood - logsumexp(log_likelihood))
    low, high = np.interp(INTERVAL, np.cumsum(share), p)
    return float(share @ p), float(low), float(high)
