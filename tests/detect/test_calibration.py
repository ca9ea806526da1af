import json

import numpy as np
import pytest
from scipy.special import expit

from detect.calibration import (
    Calibration,
    ClassCalibration,
    expected_calibration_error,
    posterior_probability,
)
from geometry.errors import BadInputError

NAMES = ("loud", "silent", "empty")


def drawn(count: int = 40_000, prior: float = 0.1) -> tuple[np.ndarray, np.ndarray]:
    """A score whose true log likelihood ratio is 2 score - 2, and one that is noise."""
    rng = np.random.default_rng(0)
    labels = rng.random(count) < prior
    scores = rng.normal(size=(count, 2))
    scores[labels, 0] += 2
    return scores, labels


@pytest.fixture(scope="module")
def calibration() -> Calibration:
    scores, labels = drawn()
    noise = np.random.default_rng(1).normal(size=scores.shape)
    return Calibration.fit(
        np.concatenate([scores, noise]),
        np.concatenate([labels, labels]),
        np.repeat(np.array([0, 1], np.uint8), len(labels)),
        score_names=("a", "b"),
        class_names=NAMES,
    )


def test_the_true_likelihood_ratio_is_found_whatever_the_prior() -> None:
    for prior in (0.03, 0.3):
        scale = ClassCalibration.fit(*drawn(prior=prior))
        assert scale is not None
        assert scale.weights == pytest.approx((2, 0), abs=0.1)
        middle = scale.llr(np.array([[1.0, 0.0], [1.5, 0.0]], np.float32))
        assert middle == pytest.approx([0, 1], abs=0.12)


def test_evidence_is_bounded(calibration: Calibration) -> None:
    scores = np.array([[[-9, 0], [9, 0]]], np.float32)
    llr = calibration.llr(scores, np.zeros((1, 2), np.uint8), NAMES)
    np.testing.assert_array_equal(llr, np.float32([[-1.5, 4]]))


def test_a_class_that_says_nothing_is_silent(calibration: Calibration) -> None:
    assert set(calibration.scales) == {"loud"}
    scores = np.full((2, 3, 2), 5, np.float32)
    classes = np.array([[0, 1, 2], [1, 0, 2]], np.uint8)
    llr = calibration.llr(scores, classes, NAMES)
    np.testing.assert_array_equal(llr != 0, classes == 0)


def test_too_few_of_a_kind_are_silent() -> None:
    scores, labels = drawn()
    few = np.flatnonzero(labels)[::25]
    rows = np.concatenate([few, np.flatnonzero(~labels)])
    assert ClassCalibration.fit(scores[rows], labels[rows]) is None


def test_a_score_that_means_the_opposite_elsewhere_is_silent() -> None:
    scores, labels = drawn()
    scores[20_000:, 0] *= -1
    assert ClassCalibration.fit(scores, labels) is None


def test_a_perfect_score_keeps_a_finite_slope() -> None:
    labels = np.arange(2000) % 2 == 0
    scale = ClassCalibration.fit(np.where(labels, 1.0, -1.0)[:, None], labels)
    assert scale is not None
    assert 2 < scale.weights[0] < 20


def test_it_survives_json(calibration: Calibration) -> None:
    plain = json.loads(json.dumps(calibration.to_plain()))
    assert Calibration.from_plain(plain, "file") == calibration


@pytest.mark.parametrize(
    "content",
    [
        None,
        [],
        {"scores": ["a"]},
        {"scores": ["a"], "classes": {"x": {"weights": [1]}}},
        {"scores": ["a"], "classes": {"x": 3}},
        {"scores": ["a"], "classes": {"x": {"weights": [1, 2], "offset": 0, "prior": 0.1,
                                            "auroc": 0.9}}},
    ],
)  # fmt: skip
def test_what_is_no_calibration_is_refused(content: object) -> None:
    with pytest.raises(BadInputError, match="file: "):
        Calibration.from_plain(content, "file")


def test_calibration_error_of_honest_and_of_bold_probabilities() -> None:
    rng = np.random.default_rng(0)
    stated = rng.random(100_000)
    happens = rng.random(100_000) < stated
    assert expected_calibration_error(stated, happens) < 0.005
    bold = expit(3 * np.log(stated / (1 - stated)))
    assert expected_calibration_error(bold, happens) > 0.1
    assert expected_calibration_error([0.9, 0.9], [True, False]) == pytest.approx(0.4)
    assert np.isnan(expected_calibration_error([], []))


def test_evidence_of_zero_leaves_the_prior(calibration: Calibration) -> None:
    assert posterior_probability(np.zeros(1, np.float32), 0.2) == pytest.approx(0.2)


def test_fitted_probabilities_are_calibrated(calibration: Calibration) -> None:
    scores, labels = drawn()
    scale = calibration.scales["loud"]
    stated = posterior_probability(scale.llr(scores.astype(np.float32)), scale.prior)
    assert expected_calibration_error(stated, labels) < 0.02
