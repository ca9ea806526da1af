from dataclasses import replace

import numpy as np
import pytest

from locate.fusion.axis.sightings import find_bending_sign, sight_axis
from locate.fusion.search.columns import PlumeColumn
from locate.fusion.views import Views
from locate.simulation.evidence import NO_FAULTS, make_faulty_views, orbit_trajectory, random_column


@pytest.fixture(scope="module")
def column() -> PlumeColumn:
    return random_column(np.random.default_rng(5)).column


@pytest.fixture(scope="module")
def views() -> Views:
    truth = random_column(np.random.default_rng(5))
    return make_faulty_views(truth, orbit_trajectory(8, 60), np.random.default_rng(1), NO_FAULTS)


def test_light_bent_towards_the_axis_is_measured_as_well(views: Views, column: PlumeColumn) -> None:
    warm = sight_axis(views, column)
    dense = sight_axis(replace(views, displacement=-views.displacement), column)
    assert set(warm.bending_sign) == {1}
    assert set(dense.bending_sign) == {-1}
    np.testing.assert_allclose(warm.offset_px, dense.offset_px)
    np.testing.assert_allclose(warm.sigma_px, dense.sigma_px)


def test_which_way_light_is_bent_is_stated_where_views_agree(
    views: Views, column: PlumeColumn
) -> None:
    dense = -views.displacement
    assert find_bending_sign(views, column) == 1
    assert find_bending_sign(replace(views, displacement=dense), column) == -1
    every_other = np.where(np.arange(len(views))[:, None, None, None] % 2, 1, -1)
    assert find_bending_sign(replace(views, displacement=every_other * dense), column) == 0
    few = views.with_evidence(views.llr * (np.arange(len(views)) < 3)[:, None, None])
    assert find_bending_sign(few, column) == 0


def test_where_the_displacement_turns_counts_for_more_than_the_outline(
    views: Views, column: PlumeColumn
) -> None:
    beside = np.maximum(views.llr, np.roll(views.llr, 4, axis=2))
    smeared = replace(views, llr=beside)
    blind = replace(smeared, displacement=0 * views.displacement)
    unknown = replace(smeared, sigma_px=np.full_like(views.sigma_px, np.inf))
    shifts = [
        abs(np.median(sight_axis(each, column).offset_px)) for each in (smeared, blind, unknown)
    ]
    assert shifts[0] < 0.5
    assert min(shifts[1:]) > 1.5


def test_noise_that_nobody_stated_makes_sightings_less_sure(
    views: Views, column: PlumeColumn
) -> None:
    noise = np.random.default_rng(2).normal(size=views.displacement.shape)
    noisy = replace(views, displacement=(views.displacement + noise).astype(np.float32))
    calm, unsure = (np.median(sight_axis(each, column).sigma_px) for each in (views, noisy))
    assert unsure > 2 * calm


def test_a_known_bending_sign_is_used(views: Views, column: PlumeColumn) -> None:
    turned = replace(views, displacement=-views.displacement)
    alone = sight_axis(turned, column, bending_sign=1)
    known = sight_axis(turned, column, bending_sign=-1)
    assert np.abs(known.offset_px).mean() < 0.5 * np.abs(alone.offset_px).mean()


def test_views_with_other_evidence_have_their_own_precision(views: Views) -> None:
    unit, known = views.unit, views.displacement_precision
    silent = views.with_evidence(0 * views.llr)
    assert silent.unit == unit
    assert known.any()
    assert not silent.displacement_precision.any()
