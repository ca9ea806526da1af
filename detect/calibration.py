"""From a detector's scores to calibrated log-likelihood ratios."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import expit, logit

from detect.evidence import LLR_MAX, LLR_MIN
from detect.scores import auroc
from geometry.arrays import BoolArray, FloatArray, FloatMap
from geometry.errors import BadInputError
from geometry.json_values import check_fields

LEAST_AUROC = 0.6
"""A class where refraction is separated worse than this has no evidence."""
LEAST_OF_EACH = 100
RIDGE = 1e-6
NEWTON_STEPS = 50
LARGEST_STEP = 2.0
BINS = 15


@dataclass(frozen=True, kw_only=True)
class ClassCalibration:
    """Of one class: log odds = weights . scores + offset.

    Attributes:
        weights: One for each score.
        offset: Log odds at scores of zero, in the data it was fitted on.
        prior: Share of positives in these data.
        auroc: How well it separates them where it was not fitted: the worse of two halves.
    """

    weights: tuple[float, ...]
    offset: float
    prior: float
    auroc: float

    @classmethod
    def fit(cls, scores: FloatArray, labels: BoolArray) -> Self | None:
        """Logistic regression; None where it would separate nothing.

        Source: Platt, Advances in Large Margin Classifiers (1999) 61, for one score.

        Args:
            scores: (N, S) finite; in the order of their images, as both halves must separate.
            labels: (N,) true where positive.
        """
        middle = len(labels) // 2
        halves = [slice(None, middle), slice(middle, None)]
        if any(min(labels[h].sum(), (~labels[h]).sum()) < LEAST_OF_EACH for h in halves):
            return None
        crossed = [
            auroc(scores[there] @ fit_logistic(scores[here], labels[here])[:-1], labels[there])
            for here, there in (halves, halves[::-1])
        ]
        if min(crossed) < LEAST_AUROC:
            return None
        weights = fit_logistic(scores, labels)
        return cls(
            weights=tuple(float(weight) for weight in weights[:-1]),
            offset=float(weights[-1]),
            prior=float(labels.mean()),
            auroc=min(crossed),
        )

    def llr(self, scores: FloatMap) -> FloatMap:
        """(N,) nats, without bounds, of (N, S) scores: the log odds without the prior's."""
        odds = scores @ np.array(self.weights, np.float32) + (self.offset - logit(self.prior))
        return np.asarray(odds, dtype=np.float32)


@dataclass(frozen=True, kw_only=True)
class Calibration:
    """One for each class that has evidence.

    Attributes:
        scores: Names of the scores, in order.
        scales: By the name of the class; a class that is not here has no evidence.
    """

    scores: tuple[str, ...]
    scales: Mapping[str, ClassCalibration]

    @classmethod
    def fit(
        cls,
        scores: FloatArray,
        labels: BoolArray,
        classes: NDArray[np.uint8],
        *,
        score_names: Sequence[str],
        class_names: Sequence[str],
    ) -> Self:
        """Fits each class by itself, on samples that nothing was trained on.

        Args:
            scores: (N, S) finite.
            labels: (N,) true where there is refraction.
            classes: (N,) index into `class_names`.
            score_names: (S,).
            class_names: Of the classes.
        """
        scales = {}
        for k, name in enumerate(class_names):
            members = classes == k
            scale = ClassCalibration.fit(scores[members], labels[members])
            if scale is not None:
                scales[name] = scale
        return cls(scores=tuple(score_names), scales=scales)

    def llr(
        self,
        scores: FloatMap,
        classes: NDArray[np.uint8],
        class_names: Sequence[str],
        *,
        most: tuple[float, float] = (LLR_MIN, LLR_MAX),
    ) -> FloatMap:
        """(H, W) evidence in nats; 0 where the class has none.

        Args:
            scores: (H, W, S).
            classes: (H, W) index into `class_names`.
            class_names: Of the classes.
            most: Bounds; a score of one kind of refraction must not overrule all else.
        """
        llr = np.zeros(classes.shape, np.float32)
        for k, name in enumerate(class_names):
            members = classes == k
            if name in self.scales and members.any():
                np.copyto(llr, self.scales[name].llr(scores).clip(*most), where=members)
        return llr

    def to_plain(self) -> dict[str, Any]:
        """As JSON knows it."""
        scales = {name: vars(scale) for name, scale in self.scales.items()}
        return {"scores": list(self.scores), "classes": scales}

    @classmethod
    def from_plain(cls, content: Any, where: str) -> Self:
        """Reads what `to_plain` made.

        Raises:
            BadInputError: It is something else.
        """
        try:
            names = tuple(str(name) for name in content["scores"])
            scales = {
                str(name): check_fields(ClassCalibration, scale)
                for name, scale in content["classes"].items()
            }
        except (AttributeError, KeyError, TypeError, ValueError) as error:
            raise BadInputError(f"{where}: not a calibration ({error!r})") from error
        if any(len(scale.weights) != len(names) for scale in scales.values()):
            raise BadInputError(f"{where}: a calibration needs a weight for each of {names}")
        return cls(scores=names, scales=scales)


def expected_calibration_error(probabilities: ArrayLike, labels: ArrayLike) -> float:
    """How far stated probabilities are from what happens, on average.

    Source: Naeini, Cooper, Hauskrecht, AAAI (2015) 2901, equal bins of probability.

    Args:
        probabilities: (...) of being positive.
        labels: (...) true where positive.

    Returns:
        Mean over the samples of |share of positives - mean probability| of their bin; NaN of none.
    """
    stated = np.asarray(probabilities, dtype=float).ravel()
    happened = np.asarray(labels, dtype=float).ravel()
    if not stated.size:
        return float("nan")
    which = np.minimum((stated * BINS).astype(int), BINS - 1)
    gaps = np.bincount(which, weights=happened - stated, minlength=BINS)
    return float(np.abs(gaps).sum() / stated.size)


def posterior_probability(llr: FloatMap, prior: float) -> FloatMap:
    """Probability of refraction by the evidence and its share beforehand."""
    return np.asarray(expit(llr + logit(prior)), dtype=np.float32)


def fit_logistic(scores: FloatArray, labels: BoolArray) -> FloatArray:
    """Weights of the largest likelihood, the offset last; Newton's method, a trace of ridge.

    Targets are Platt's: (n + 1) / (n + 2) and 1 / (n + 2), not 1 and 0, so that a perfect score
    keeps a finite slope.
    """
    design = np.column_stack([scores, np.ones(len(scores))])
    positives, negatives = labels.sum(), (~labels).sum()
    targets = np.where(labels, (positives + 1) / (positives + 2), 1 / (negatives + 2))
    spread = np.maximum(np.abs(design).mean(axis=0), 1e-12)
    scaled = design / spread
    weights = np.zeros(design.shape[1])
    ridge = RIDGE * len(labels) * np.eye(len(weights))
    for _ in range(NEWTON_STEPS):
        p = expit(scaled @ weights)
        slope = scaled.T @ (p - targets) + ridge @ weights
        curvature = (scaled * (p * (1 - p))[:, None]).T @ scaled + ridge
        step = np.linalg.solve(curvature, slope)
        weights -= step * min(1, LARGEST_STEP / np.abs(step).max(initial=1e-12))
        if np.abs(step).max() < 1e-9:
            break
    return np.asarray(weights / spread)
