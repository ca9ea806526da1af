"""What many flights give together: hotspots, offsets, drift, and how often."""

from dataclasses import replace

import numpy as np
import pytest

from geometry.arrays import FloatArray, IntArray
from geometry.georeference.constraints import point_jacobian
from geometry.similarity import Similarity
from locate.survey.associate import associate
from locate.survey.frame import FlightOffset, PlumeSighting
from locate.survey.graph import solve_graph
from locate.survey.occurrence import beta_posterior, hotspot_posterior, pooled_prior
from tests.locate.answers import plume

SIGMAS = np.array([0.002, 0.002, 0.004, 1.0, 1.0, 2.0, 0.002])
OWN_M, WANDER_M = 0.3, 0.5
MANY = 150
"""Flights, enough for a few sightings to lie far from the others of their hotspot by chance."""
STILL = Similarity(scale=1.0, rotation=np.eye(3), translation=np.zeros(3))


def offset(flight: int) -> FlightOffset:
    return FlightOffset(flight=str(flight), survey_from_flight=STILL, covariance=np.diag(SIGMAS**2))


def sighting(flight: int, position: FloatArray) -> PlumeSighting:
    return PlumeSighting(
        flight=flight,
        plume=plume(position),
        position=position,
        own_covariance=OWN_M**2 * np.eye(3),
        offset_jacobian=point_jacobian(position[None])[0],
        axis=np.array([0.0, 0.0, 1.0]),
    )


def flown(
    sites: FloatArray, leans: FloatArray, drift_m: float, rng: np.random.Generator
) -> tuple[list[PlumeSighting], IntArray]:
    """Every flight sees every site."""
    seen, truth = [], []
    for flight, lean in enumerate(leans):
        tangent = SIGMAS * rng.normal(size=7)
        for k, site in enumerate(sites):
            foot = site.copy()
            foot[:2] += rng.normal(0, WANDER_M, 2) + drift_m * lean
            moved = foot + point_jacobian(foot[None])[0] @ tangent
            seen.append(sighting(flight, moved + rng.normal(0, OWN_M, 3)))
            truth.append(k)
    return seen, np.array(truth)


SITES = np.array([[0.0, 0.0, 0.0], [20.0, 5.0, 1.0], [-15.0, 25.0, 0.0]])


def test_the_covariance_of_a_hotspot_is_honest() -> None:
    rng = np.random.default_rng(7)
    nees, drifts = [], []
    for _ in range(40):
        leans = rng.normal(0, 0.2, (5, 2))
        leans -= leans.mean(axis=0)
        seen, truth = flown(SITES, leans, 6.0, rng)
        solved = solve_graph(seen, truth, [offset(f) for f in range(5)], leans, WANDER_M)
        for position, covariance, site in zip(
            solved.positions, solved.covariances, SITES, strict=True
        ):
            nees.append((position - site) @ np.linalg.solve(covariance, position - site) / 3)
        drifts.append((solved.shared.drift_m - 6.0) / solved.shared.drift_sigma_m)
    assert 0.7 < np.mean(nees) < 1.4
    assert 0.7 < np.std(drifts) < 1.4


def test_flights_together_know_more_than_one() -> None:
    rng = np.random.default_rng(8)
    leans = np.zeros((8, 2))
    seen, truth = flown(SITES, leans, 0.0, rng)
    offsets = [offset(f) for f in range(8)]
    together = solve_graph(seen, truth, offsets, leans, WANDER_M).covariances[0]
    alone = solve_graph(seen[:3], truth[:3], offsets[:1], leans[:1], WANDER_M).covariances[0]
    assert np.trace(together) < np.trace(alone) / 5


def test_a_wrong_association_moves_its_hotspot_little() -> None:
    rng = np.random.default_rng(9)
    leans = np.zeros((6, 2))
    seen, truth = flown(SITES, leans, 0.0, rng)
    offsets = [offset(f) for f in range(6)]
    clean = solve_graph(seen, truth, offsets, leans, WANDER_M)
    wrong = sighting(4, SITES[0] + [18.0, -12.0, 0.0])
    spoilt = solve_graph(
        [wrong if (s.flight, k) == (4, 0) else s for s, k in zip(seen, truth, strict=True)],
        truth, offsets, leans, WANDER_M,
    )  # fmt: skip
    shift = np.linalg.norm((spoilt.positions - clean.positions)[:, :2], axis=1)
    assert shift.max() < np.sqrt(clean.covariances[0, 0, 0])
    assert spoilt.weights[4 * len(SITES)] < 0.01
    assert np.median(spoilt.weights) == 1.0


def test_sightings_find_their_hotspots() -> None:
    rng = np.random.default_rng(10)
    leans = rng.normal(0, 0.2, (6, 2))
    leans -= leans.mean(axis=0)
    seen, truth = flown(SITES, leans, 8.0, rng)
    fused = associate(seen, [offset(f) for f in range(6)], leans, wander_m=WANDER_M, area_m2=2500.0)
    assert np.array_equal(fused.hotspot_of, truth)
    assert abs(fused.solution.shared.drift_m - 8.0) < 3 * fused.solution.shared.drift_sigma_m


def test_many_flights_do_not_split_a_hotspot() -> None:
    leans = np.zeros((MANY, 2))
    seen, truth = flown(SITES, leans, 0.0, np.random.default_rng(5))
    offsets = [offset(f) for f in range(MANY)]
    fused = associate(seen, offsets, leans, wander_m=WANDER_M, area_m2=2500.0)
    np.testing.assert_array_equal(fused.hotspot_of, truth)


def test_one_flight_never_sees_one_hotspot_twice() -> None:
    pair = [sighting(0, np.zeros(3)), sighting(0, np.array([0.1, 0.0, 0.0]))]
    other = sighting(1, np.array([0.05, 0.0, 0.0]))
    fused = associate(
        [*pair, other], [offset(0), offset(1)], np.zeros((2, 2)), wander_m=0.5, area_m2=2500.0
    )
    assert fused.hotspot_of[0] != fused.hotspot_of[1]
    assert len(fused.solution.positions) == 2


def test_no_sighting_is_no_hotspot() -> None:
    fused = associate([], [offset(0)], np.zeros((1, 2)), wander_m=0.5, area_m2=2500.0)
    assert len(fused.solution.positions) == 0
    assert len(fused.solution.covariances) == 0


@pytest.mark.parametrize("true", [0.2, 0.5, 0.9])
def test_how_often_a_hotspot_is_there_is_not_flattered_by_its_discovery(true: float) -> None:
    rng = np.random.default_rng(11)
    seen = rng.binomial(6, true, 4000)
    found = seen[seen > 0]
    answers = {k: hotspot_posterior(6, int(k), known_by_sight=True) for k in range(1, 7)}
    inside = np.mean([answers[k][1] <= true <= answers[k][2] for k in found])
    assert inside > 0.85
    naive = hotspot_posterior(6, 1, known_by_sight=False)
    assert answers[1][0] < naive[0]


def test_a_cell_knows_how_often_it_was_covered() -> None:
    looked, seen = np.array([0.0, 1.0, 8.0, 8.0]), np.array([0.0, 0.0, 0.0, 8.0])
    prior = pooled_prior(looked, seen)
    assert prior[0] == pytest.approx(8.5 / 18)
    mean, low, high = beta_posterior(looked, seen, prior)
    assert np.isnan([mean[0], low[0], high[0]]).all()
    assert mean[1] == pytest.approx(prior[0] / 2)
    assert mean[2] == pytest.approx(prior[0] / 9)
    assert mean[3] == pytest.approx((prior[0] + 8) / 9)
    assert (low[1:] < mean[1:]).all()
    assert (mean[1:] < high[1:]).all()


def test_an_offset_in_another_frame_turns_with_it() -> None:
    quarter = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])
    turned = replace(
        offset(0),
        survey_from_flight=Similarity(
            scale=1.0, rotation=quarter, translation=np.array([5.0, 0, 0])
        ),
    )
    east_of_flight = np.array([0, 0, 0, 1.0, 0, 0, 0])
    np.testing.assert_allclose(
        turned.jacobian(np.zeros(3))[0] @ east_of_flight, [0, 1, 0], atol=1e-12
    )
