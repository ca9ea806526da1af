import numpy as np
import pytest

from locate.fusion.axis import sight_axis
from locate.fusion.base import locate_base
from locate.fusion.column import score, spine, without
from locate.fusion.fuse import fuse
from locate.fusion.graph import estimate_axis
from locate.fusion.proposals import best_interval
from locate.simulation.evidence import NONE, Corruption, Truth, corrupted_views, orbit, random_truth


def as_column(truth: Truth) -> np.ndarray:
    return np.array([*truth.source, *truth.slope, truth.height, truth.radius, truth.opening])


@pytest.fixture(scope="module")
def truth() -> Truth:
    return random_truth(np.random.default_rng(5))


def test_source_is_found_within_its_covariance(truth: Truth) -> None:
    views = corrupted_views(truth, orbit(10, 60), np.random.default_rng(5))
    (plume,) = fuse(views).plumes
    error = plume.source - truth.source
    assert np.linalg.norm(error) < 0.02 * 8.5
    assert error @ np.linalg.solve(plume.source_covariance, error) < 16
    assert np.degrees(np.arccos(plume.axis @ truth.axis)) < 8
    assert plume.probability > 0.99


def test_same_seed_same_answer(truth: Truth) -> None:
    views = corrupted_views(truth, orbit(6, 60), np.random.default_rng(0))
    first, second = (fuse(views, seed=3).plumes for _ in range(2))
    assert [p.source.tolist() for p in first] == [p.source.tolist() for p in second]


@pytest.mark.parametrize("seed", range(3))
def test_clutter_alone_is_no_plume(seed: int) -> None:
    rng = np.random.default_rng(100 + seed)
    views = corrupted_views(None, orbit(10, 60), rng, Corruption(false_blobs=1.0))
    assert fuse(views).plumes == ()


def test_true_column_scores_more_than_its_neighbours(truth: Truth) -> None:
    views = corrupted_views(truth, orbit(8, 60), np.random.default_rng(0), NONE)
    columns = np.repeat(as_column(truth)[None], 5, axis=0)
    columns[1:, :2] += [[0.5, 0], [-0.5, 0], [0, 0.8], [0, -0.8]]
    nats = score(views, columns).sum(axis=0)
    assert nats.argmax() == 0
    assert nats[0] > 1.2 * nats[1:].max()


def test_evidence_of_a_plume_is_used_once(truth: Truth) -> None:
    views = corrupted_views(truth, orbit(8, 60), np.random.default_rng(0), NONE)
    column = as_column(truth)
    left = without(views, column)
    assert score(left, column[None]).sum() < 0.1 * score(views, column[None]).sum()
    assert (views.llr > 0).any()


def test_base_reaches_down_to_the_ground(truth: Truth) -> None:
    views = corrupted_views(truth, orbit(8, 60), np.random.default_rng(0), NONE)
    column = as_column(truth)
    column[:3] = spine(column[None], np.array([[0.3]]))[0, 0]
    column[5] -= 0.3
    base = locate_base(views, column, views.unit)
    assert base.height == pytest.approx(-0.3, abs=0.12)
    assert not base.hidden
    assert base.sigma < 0.3


def test_axis_of_a_shifted_column_is_pulled_back(truth: Truth) -> None:
    views = corrupted_views(truth, orbit(12, 60), np.random.default_rng(1), NONE)
    column = as_column(truth)
    column[0] += 0.1
    sightings = sight_axis(views, column)
    axis = estimate_axis(views.trajectory, column, sightings, views.unit)
    assert axis is not None
    point, covariance = axis.at(0.0)
    assert abs(point[0] - truth.source[0]) < 0.05
    assert np.linalg.eigvalsh(covariance).min() > -1e-12


def test_wider_arc_is_surer(truth: Truth) -> None:
    sigmas = []
    for arc in (20, 60):
        views = corrupted_views(truth, orbit(10, arc), np.random.default_rng(2))
        (plume,) = fuse(views).plumes
        sigmas.append(plume.principal_sigmas[0])
    assert sigmas[0] > 1.5 * sigmas[1]


def test_best_interval_is_the_largest_run_sum() -> None:
    evidence = np.array([-1, 2, 3, -1, 2, -9, 4], np.float32)[:, None, None]
    total, first, last = best_interval(evidence)
    assert (total.item(), first.item(), last.item()) == (6, 1, 4)
