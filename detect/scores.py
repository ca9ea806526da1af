"""How well a score separates two classes: exact, rank based, ties handled."""

import numpy as np
from numpy.typing import ArrayLike

from geometry.arrays import BoolArray, FloatArray


def auroc(scores: ArrayLike, labels: ArrayLike) -> float:
    """Area under the ROC curve: the chance that a positive outscores a negative, ties half.

    Source: the Mann-Whitney U statistic over the number of pairs.

    Args:
        scores: (...) scores, higher means positive; finite.
        labels: (...) true where positive.

    Returns:
        0 to 1; NaN where one class is empty.
    """
    scores, labels = _flatten_pair(scores, labels)
    positives, negatives = int(labels.sum()), int((~labels).sum())
    if not positives or not negatives:
        return float("nan")
    from scipy.stats import rankdata  # a second to import, which no run needs

    rank_sum = float(rankdata(scores)[labels].sum())
    return (rank_sum - positives * (positives + 1) / 2) / (positives * negatives)


def average_precision(scores: ArrayLike, labels: ArrayLike) -> float:
    """Mean of the precision over the positives, by descending score; ties enter together.

    Args:
        scores: (...) scores, higher means positive; finite.
        labels: (...) true where positive.

    Returns:
        0 to 1; the share of positives for a score without information; NaN without positives.
    """
    scores, labels = _flatten_pair(scores, labels)
    order = np.argsort(-scores, kind="stable")
    group_ends = np.append(np.flatnonzero(np.diff(scores[order])), len(scores) - 1)
    hits = np.cumsum(labels[order])[group_ends]
    if not len(scores) or not hits[-1]:
        return float("nan")
    precision = hits / (group_ends + 1)
    return float((np.diff(hits, prepend=0) * precision).sum() / hits[-1])


def _flatten_pair(scores: ArrayLike, labels: ArrayLike) -> tuple[FloatArray, BoolArray]:
    scores, labels = np.asarray(scores, dtype=float), np.asarray(labels, dtype=bool)
    if scores.shape != labels.shape:
        raise ValueError(f"{scores.shape=}, {labels.shape=}, expected the same")
    return scores.ravel(), labels.ravel()
