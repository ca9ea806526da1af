import numpy as np
import pytest

from detect.scores import auroc, average_precision


def by_counting_pairs(scores: np.ndarray, labels: np.ndarray) -> float:
    positives, negatives = scores[labels], scores[~labels]
    wins = (positives[:, None] > negatives).mean()
    return wins + 0.5 * (positives[:, None] == negatives).mean()


def test_auroc_counts_pairs_and_halves_ties() -> None:
    rng = np.random.default_rng(0)
    scores, labels = rng.integers(0, 6, 200), rng.random(200) < 0.3
    assert auroc(scores, labels) == pytest.approx(by_counting_pairs(scores, labels))


def test_average_precision_of_a_ranking_by_hand() -> None:
    labels = [True, False, True, False]
    assert average_precision([4, 3, 2, 1], labels) == pytest.approx((1 + 2 / 3) / 2)
    assert average_precision([1, 2, 3, 4], labels) == pytest.approx((1 / 2 + 2 / 4) / 2)


def test_average_precision_ignores_the_order_within_ties() -> None:
    assert average_precision([1, 1, 1, 1], [True, False, False, False]) == pytest.approx(0.25)
    assert average_precision([1, 1, 1, 1], [False, False, False, True]) == pytest.approx(0.25)


def test_perfect_and_empty() -> None:
    assert auroc([2, 1], [True, False]) == 1
    assert average_precision([2, 1], [True, False]) == 1
    assert np.isnan(auroc([1, 2], [True, True]))
    assert np.isnan(average_precision([1, 2], [False, False]))


def test_shapes_must_agree() -> None:
    with pytest.raises(ValueError, match="expected the same"):
        auroc([1, 2, 3], [True, False])
