"""Similarity transforms: group laws, and recovery from point pairs."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from geometry.similarity import Similarity, align_points

seeds = st.integers(0, 10_000)


def random_similarity(random: np.random.Generator) -> Similarity:
    return Similarity(
        scale=float(np.exp(random.normal())),
        rotation=Rotation.random(rng=random).as_matrix(),
        translation=random.normal(scale=10, size=3),
    )


@given(seeds)
def test_inverse(seed: int) -> None:
    random = np.random.default_rng(seed)
    transform, points = random_similarity(random), random.normal(size=(2, 5, 3))
    np.testing.assert_allclose(transform.inverse()(transform(points)), points, atol=1e-9)


@given(seeds)
def test_align_recovers_the_transform(seed: int) -> None:
    random = np.random.default_rng(seed)
    truth, points = random_similarity(random), random.normal(size=(8, 3))
    found = align_points(points, truth(points))
    assert found.scale == pytest.approx(truth.scale)
    np.testing.assert_allclose(found.rotation, truth.rotation, atol=1e-8)
    np.testing.assert_allclose(found.translation, truth.translation, atol=1e-7)


def test_align_never_mirrors() -> None:
    points = np.random.default_rng(0).normal(size=(20, 3))
    found = align_points(points, points * [1, 1, -1])
    assert np.linalg.det(found.rotation) == pytest.approx(1)


def test_align_with_fixed_scale() -> None:
    points = np.random.default_rng(0).normal(size=(20, 3))
    assert align_points(points, 3 * points, fix_scale=True).scale == 1.0


def test_covariance_is_that_of_moved_samples() -> None:
    random = np.random.default_rng(0)
    transform = random_similarity(random)
    samples = random.normal(size=(200, 3)) * [1, 2, 0.3]
    np.testing.assert_allclose(
        transform.transform_covariance(np.cov(samples.T)), np.cov(transform(samples).T), atol=1e-9
    )


@pytest.mark.parametrize(("n", "m"), [(2, 2), (4, 5)])
def test_align_refuses_what_it_cannot_use(n: int, m: int) -> None:
    with pytest.raises(ValueError, match="expected"):
        align_points(np.zeros((n, 3)), np.zeros((m, 3)))
