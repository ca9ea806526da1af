"""The picture of arcs states the sigmas of the rays it draws."""

import numpy as np
import pytest

from benchmarks.pictures.arcs import FOCAL_PX, RANGE_M, SIGMA_PX, VIEWS, source_sigmas_m

ACROSS_M = RANGE_M * SIGMA_PX / FOCAL_PX


def test_small_arc_is_a_stack_of_nearly_parallel_rays() -> None:
    depth, sideways = source_sigmas_m(1.0)
    spread = np.radians(np.linspace(-0.5, 0.5, VIEWS))
    assert sideways == pytest.approx(ACROSS_M / np.sqrt(VIEWS), rel=1e-3)
    assert depth == pytest.approx(ACROSS_M / np.linalg.norm(spread), rel=1e-3)


def test_rays_from_all_around_know_both_directions_alike() -> None:
    whole_turn = 360 * (VIEWS - 1) / VIEWS
    assert np.ptp(source_sigmas_m(whole_turn)) < 1e-9
