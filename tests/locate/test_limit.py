from dataclasses import replace

import numpy as np
import pytest

from locate.fusion.limit import AMPLITUDES_PX, detection_limit_px
from locate.simulation.evidence import NONE, corrupted_views, orbit


@pytest.fixture(scope="module")
def views():
    return corrupted_views(None, orbit(6, 60), np.random.default_rng(0), NONE)


def test_limit_rises_with_sigma(views) -> None:
    limits = [
        detection_limit_px(replace(views, sigma_px=np.full_like(views.llr, s)), 20.0, views.unit)
        for s in (0.02, 0.2)
    ]
    assert limits[0] < limits[1]


def test_limit_rises_with_the_threshold(views) -> None:
    low, high = (detection_limit_px(views, nats, views.unit) for nats in (5.0, 10_000.0))
    assert low < high


def test_unmeasured_views_have_no_limit(views) -> None:
    blind = replace(views, sigma_px=np.full_like(views.llr, np.inf))
    assert detection_limit_px(blind, 20.0, views.unit) is None


def test_limit_is_one_of_the_amplitudes(views) -> None:
    assert detection_limit_px(views, 20.0, views.unit) in AMPLITUDES_PX
