import numpy as np
import pytest

from detect.registered.pose_errors import SOME, PoseErrors
from detect.registered.robust_separation import median_map
from detect.registered.separation import separate_parallax

SHAPE = (24, 32)


def test_depth_and_refraction_are_separated() -> None:
    rng = np.random.default_rng(0)
    baselines = np.array([-3.0, -2.0, 2.0, 3.0, 4.0])[:, None, None, None]
    slopes = (baselines * np.array([10.0, 1.0])[:, None, None] * np.ones(SHAPE)).astype(np.float32)
    step = rng.normal(0, 0.05, SHAPE).astype(np.float32)
    w = rng.normal(0, 0.5, (2, *SHAPE)).astype(np.float32)
    flows = slopes * step + w
    answer = separate_parallax(flows, slopes, np.ones((5, *SHAPE), np.float32))
    np.testing.assert_allclose(answer.inverse_depth_step, step, atol=1e-3)
    np.testing.assert_allclose(answer.displacement, w, atol=1e-3)
    assert answer.squared_residuals(flows, slopes).max() < 1e-4


def test_the_variance_factor_is_that_of_many_draws() -> None:
    rng = np.random.default_rng(1)
    slopes = np.zeros((4, 2, 200, 200), np.float32)
    slopes[:, 0] = np.array([1.0, 2.0, 3.0, 5.0])[:, None, None] * 10
    noise = rng.normal(0, 0.1, slopes.shape).astype(np.float32)
    answer = separate_parallax(noise, slopes, np.ones((4, 200, 200), np.float32))
    spread = (answer.displacement**2).mean() / 0.01
    assert answer.variance_factor.mean() == pytest.approx(spread, rel=0.05)


def test_a_pixel_nobody_sees_stays_finite() -> None:
    slopes = np.ones((3, 2, *SHAPE), np.float32)
    answer = separate_parallax(slopes, slopes, np.zeros((3, *SHAPE), np.float32))
    assert np.isfinite(answer.displacement).all()


def test_a_pose_error_is_taken_out_and_a_plume_left() -> None:
    y, x = np.meshgrid(np.linspace(-0.5, 0.5, 96), np.linspace(-0.5, 0.5, 128), indexing="ij")
    depth = np.where(x > 0.2, 2.0, 1.0).astype(np.float32)
    error = np.stack([0.3 + 0.2 * x * y + 0.4 * depth, 0.1 * x - 0.2 * depth * y])
    plume = np.zeros_like(error)
    plume[0, 30:50, 40:55] = 0.5
    poses = PoseErrors(depth)
    field = (error + plume).astype(np.float32)[:, SOME, SOME]
    found = poses.fit(field, np.ones_like(field[0]))
    whole = poses.error_fields(found, slice(None))
    np.testing.assert_allclose(whole, error, atol=0.02)
    np.testing.assert_allclose(poses.error_fields(found, slice(40, 60)), whole[:, 40:60], atol=1e-6)


def test_too_little_texture_takes_nothing_out() -> None:
    field = np.ones((2, *SHAPE), np.float32)[:, SOME, SOME]
    poses = PoseErrors(np.ones(SHAPE, np.float32))
    assert not poses.fit(field, np.zeros_like(field[0])).any()


@pytest.mark.parametrize("count", [1, 2, 3, 7, 8])
def test_the_median_of_a_few_maps(count: int) -> None:
    maps = np.random.default_rng(count).normal(size=(count, *SHAPE)).astype(np.float32)
    np.testing.assert_allclose(median_map(maps), np.median(maps, axis=0), rtol=1e-6)
