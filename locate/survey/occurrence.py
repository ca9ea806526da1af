"""How often a column is there, from how often it was looked for and seen."""

from collections.abc import Sequence

import numpy as np
from scipy.special import betaln, logsumexp
from scipy.stats import beta

from geometry.arrays import FloatArray
from locate.survey.findings import Count

ALL = "all"
PRIOR_LOOKS = 1.0
INTERVAL = (0.05, 0.95)
STEPS = 2000


def pooled_prior(looked: FloatArray, seen: FloatArray) -> tuple[float, float]:
    """Mean and weight (in looks) of the Beta prior of one cell: the survey's own share of looks.

    An empirical prior: most of the ground sends up nothing, and how much does, the survey itself
    says. Half a sighting in one look is added so that it is neither 0 nor 1.
    """
    return float((seen.sum() + 0.5) / (looked.sum() + 1.0)), PRIOR_LOOKS


Prior = tuple[float | FloatArray, float]


def posterior(
    looked: FloatArray, seen: FloatArray, prior: Prior
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Mean, 5 % and 95 % quantile of Beta posteriors; NaN where nobody looked.

    Args:
        looked: How often each was looked at.
        seen: How often it was seen, at most `looked`.
        prior: Mean and weight in looks.
    """
    a, b = _parameters(looked, seen, prior)
    low, high = (np.where(looked > 0, beta.ppf(q, a, b), np.nan) for q in INTERVAL)
    return posterior_mean(looked, seen, prior), low, high


def posterior_mean(looked: FloatArray, seen: FloatArray, prior: Prior) -> FloatArray:
    """The first of `posterior`."""
    a, b = _parameters(looked, seen, prior)
    return np.where(looked > 0, a / (a + b), np.nan)


def _parameters(
    looked: FloatArray, seen: FloatArray, prior: Prior
) -> tuple[FloatArray, FloatArray]:
    mean, weight = prior
    return mean * weight + seen, (1 - np.asarray(mean)) * weight + looked - seen


def hotspot_counts(looked: Sequence[str], seen: Sequence[str]) -> tuple[Count, ...]:
    """How often a hotspot was there: in all, then in each bin that holds a look.

    Args:
        looked: The bin of every flight that looked at it, those that saw it included.
        seen: The bin of every flight that saw it.
    """
    groups = [ALL, *dict.fromkeys(looked)]
    counts = []
    for name in groups:
        n = len(looked) if name == ALL else looked.count(name)
        k = len(seen) if name == ALL else seen.count(name)
        mean, low, high = hotspot_posterior(n, k, known_by_sight=name == ALL)
        counts.append(Count(bin=name, looked=n, seen=k, probability=mean, low=low, high=high))
    return tuple(counts)


def hotspot_posterior(n: int, k: int, *, known_by_sight: bool) -> tuple[float, float, float]:
    """Mean, 5 % and 95 % quantile of how often a hotspot that was found is there.

    It is known only because it was seen at least once: the likelihood is a binomial without its
    zero, ``p^k (1 - p)^(n - k) / (1 - (1 - p)^n)``; the prior is flat.

    Args:
        n: Number of looks.
        k: Number of times it was seen.
        known_by_sight: These looks are all there were, so that k = 0 cannot be.
    """
    p = (np.arange(STEPS) + 0.5) / STEPS
    log_likelihood = k * np.log(p) + (n - k) * np.log1p(-p) - betaln(k + 1, n - k + 1)
    if known_by_sight:
        log_likelihood -= np.log(-np.expm1(n * np.log1p(-p)))
    share = np.exp(log_likelihood - logsumexp(log_likelihood))
    low, high = np.interp(INTERVAL, np.cumsum(share), p)
    return float(share @ p), float(low), float(high)
