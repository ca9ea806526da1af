"""Two detectors on one frame: the sum is bounded, discounted, and silent where both are."""

import numpy as np
import pytest

from detect.detection import Detection, Frames
from detect.fused import FusedDetector, fuse_pair
from detect.response import Response


def one(llr: float, w: float = 0.0, sigma_px: float = np.inf) -> Detection:
    return Detection(
        displacement=np.full((1, 1, 2), w, np.float32),
        sigma_px=np.full((1, 1), sigma_px, np.float32),
        llr=np.full((1, 1), llr, np.float32),
    )


def value(detection: Detection) -> float:
    return float(detection.llr[0, 0])


@pytest.mark.parametrize(
    ("first", "second", "expected"),
    [(1.0, 2.0, 2.0), (0.0, 2.0, 2.0), (1.0, 0.0, 1.0), (0.0, 0.0, 0.0), (3.5, 4.0, 4.0),
     (-1.0, -1.4, -1.5), (-1.0, 4.0, 1.0)],
)  # fmt: skip
def test_evidence_is_a_discounted_sum_within_bounds(
    first: float, second: float, expected: float
) -> None:
    answer = fuse_pair(one(first, sigma_px=0.1), one(second, sigma_px=0.1), 0.5)
    assert value(answer) == pytest.approx(expected)


def test_silent_helper_changes_nothing() -> None:
    first = one(1.3, w=0.2, sigma_px=0.1)
    answer = fuse_pair(first, one(0.0, w=5.0, sigma_px=0.001), 0.5)
    assert value(answer) == pytest.approx(1.3)
    assert answer.displacement == pytest.approx(first.displacement)
    assert answer.sigma_px == pytest.approx(first.sigma_px)


def test_helper_fills_in_where_the_first_measured_nothing() -> None:
    answer = fuse_pair(one(0.0, w=np.nan), one(2.0, w=0.3, sigma_px=0.05), 0.5)
    assert answer.displacement == pytest.approx(np.full((1, 1, 2), 0.3))
    assert answer.sigma_px[0, 0] == pytest.approx(0.05)


def test_nothing_measured_stays_unmeasured() -> None:
    answer = fuse_pair(one(0.0), one(0.0), 0.5)
    assert np.isinf(answer.sigma_px).all()
    assert not answer.displacement.any()


@pytest.mark.parametrize("shared", [0.0, 0.5, 1.0])
def test_sigma_of_the_mean_is_that_of_correlated_errors(shared: float) -> None:
    sigmas = np.array([0.1, 0.2])
    covariance = np.outer(sigmas, sigmas) * np.array([[1, shared], [shared, 1]])
    errors = np.random.default_rng(0).multivariate_normal([0, 0], covariance, 200_000)
    first = Detection(
        displacement=np.repeat(errors[None, :, :1], 2, axis=-1).astype(np.float32),
        sigma_px=np.full((1, len(errors)), 0.1, np.float32),
        llr=np.ones((1, len(errors)), np.float32),
    )
    second = Detection(
        displacement=np.repeat(errors[None, :, 1:], 2, axis=-1).astype(np.float32),
        sigma_px=np.full((1, len(errors)), 0.2, np.float32),
        llr=np.ones((1, len(errors)), np.float32),
    )
    answer = fuse_pair(first, second, shared)
    assert answer.displacement.std() == pytest.approx(float(answer.sigma_px[0, 0]), rel=0.02)


class Says:
    uses_other_frames = False

    def __init__(self, name: str, llr: float) -> None:
        self.name, self._llr = name, llr
        self.response = Response(ratios=(0.0,), llr=(llr,))

    def detect(self, frames: Frames, index: int) -> Detection:
        return one(self._llr, sigma_px=0.1)


def test_it_is_a_detector_named_after_both() -> None:
    detector = FusedDetector(Says("registered", 1.0), Says("dybs", 1.5), shared=0.0)
    assert detector.name == "registered+dybs"
    assert detector.response == Response(ratios=(0.0,), llr=(1.0,))
    assert value(detector.detect(Frames(images=[np.zeros((1, 1), np.uint8)]), 0)) == 2.5
