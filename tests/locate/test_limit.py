from dataclasses import replace

import numpy as np
import pytest

from detect.response import Response
from locate.fusion.limit import AMPLITUDES_PX, detection_limit_px, expected_llr
from locate.simulation.evidence import NO_FAULTS, make_faulty_views, orbit_trajectory


@pytest.fixture(scope="module")
def views():
    return make_faulty_views(None, orbit_trajectory(6, 60), np.random.default_rng(0), NO_FAULTS)


def test_limit_rises_with_sigma(views) -> None:
    limits = [
        detection_limit_px(replace(views, sigma_px=np.full_like(views.llr, s)), 20.0)
        for s in (0.02, 0.2)
    ]
    assert limits[0] < limits[1]


def test_limit_rises_with_the_threshold(views) -> None:
    low, high = (detection_limit_px(views, nats) for nats in (5.0, 10_000.0))
    assert low < high


def test_unmeasured_views_have_no_limit(views) -> None:
    blind = replace(views, sigma_px=np.full_like(views.llr, np.inf))
    assert detection_limit_px(blind, 20.0) is None


def test_limit_is_one_of_the_amplitudes(views) -> None:
    assert detection_limit_px(views, 20.0) in AMPLITUDES_PX


def seen_from(ratio: float) -> Response:
    return Response(ratios=(0.99 * ratio, ratio), llr=(-1.0, 2.0))


def test_limit_is_by_what_the_detector_sees(views) -> None:
    views = replace(views, sigma_px=np.full_like(views.llr, 0.1))
    for ratio in (0.7, 5.0):
        limit_px = detection_limit_px(views, 20.0, response=seen_from(ratio))
        assert limit_px == AMPLITUDES_PX[0.1 * ratio <= AMPLITUDES_PX][0]


def test_a_response_leaves_pixels_without_evidence_as_they_are(views) -> None:
    llr = views.llr.copy()
    llr[:, :10] = 0
    sigma_px = np.full_like(llr, 0.1)
    sigma_px[:, 10:20] = np.inf
    expected = expected_llr(replace(views, llr=llr, sigma_px=sigma_px), 0.2, seen_from(1.0))
    assert not expected[:, :20].any()
    np.testing.assert_array_equal(expected[llr != 0][sigma_px[llr != 0] < 1], 2)
