import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from geometry.camera import Camera
from geometry.epipolar import EpipolarGeometry
from geometry.trajectory import Trajectory


@pytest.fixture
def trajectory() -> Trajectory:
    rng = np.random.default_rng(0)
    return Trajectory(
        camera=Camera.pinhole(640, 480, 560.0),
        indices=np.arange(3),
        times_s=np.arange(3.0),
        rotations=Rotation.from_rotvec(rng.normal(0, 0.05, (3, 3))).as_matrix(),
        translations=rng.normal(0, 0.5, (3, 3)),
    )


def test_flow_agrees_with_projecting_the_points(trajectory: Trajectory) -> None:
    pixels = np.array([[10.0, 20.0], [320.0, 240.0], [600.0, 400.0]], np.float32)
    depth = np.array([4.0, 8.0, 50.0])
    rays = trajectory.camera.rays(pixels)
    in_cam = rays * (depth / rays[:, 2])[:, None]
    in_world = (in_cam - trajectory.translations[0]) @ trajectory.rotations[0]
    flow = EpipolarGeometry.between_frames(trajectory, 0, 2).flow(pixels, 1 / depth)
    np.testing.assert_allclose(pixels + flow, trajectory.project(2, in_world), atol=1e-3)


def test_the_slope_is_the_derivative(trajectory: Trajectory) -> None:
    pixels = np.array([[100.0, 50.0], [500.0, 470.0]], np.float32)
    view = EpipolarGeometry.between_frames(trajectory, 0, 1)
    _, slope = view.flow_and_slope(pixels, 0.1)
    difference = (view.flow(pixels, 0.11) - view.flow(pixels, 0.09)) / 0.02
    np.testing.assert_allclose(slope, difference, rtol=0.01, atol=0.05)


def test_a_frame_towards_itself_stands_still(trajectory: Trajectory) -> None:
    pixels = np.array([[0.0, 0.0], [639.0, 479.0]], np.float32)
    flow = EpipolarGeometry.between_frames(trajectory, 1, 1).flow(pixels, 0.2)
    np.testing.assert_allclose(flow, 0, atol=1e-3)


def test_inverse_depth_in_another_unit(trajectory: Trajectory) -> None:
    pixels = np.array([[100.0, 50.0]], np.float32)
    view = EpipolarGeometry.between_frames(trajectory, 0, 1)
    np.testing.assert_allclose(
        view.in_unit(0.1).flow(pixels, 2.0), view.flow(pixels, 0.2), atol=1e-4
    )


def test_a_grid_in_planes_is_the_same(trajectory: Trajectory) -> None:
    x, y = np.arange(3, 40, 4, dtype=np.float32), np.arange(5, 70, 2, dtype=np.float32)
    depth = np.random.default_rng(1).uniform(0, 0.3, (len(y), len(x))).astype(np.float32)
    view = EpipolarGeometry.between_frames(trajectory, 0, 1)
    together = view.flow_and_slope(np.stack(np.meshgrid(x, y), axis=-1), depth)
    for planes, field in zip(view.over_grid(x, y, depth), together, strict=True):
        np.testing.assert_allclose(np.moveaxis(planes, 0, -1), field, rtol=1e-6)


def test_towards_all_rows_at_once(trajectory: Trajectory) -> None:
    pixels = np.random.default_rng(2).uniform(0, 480, (3, 7, 2)).astype(np.float32)
    flow, slope = EpipolarGeometry.towards_all(trajectory, 0).flow_and_slope(pixels, 0.3)
    for row in range(3):
        alone = EpipolarGeometry.between_frames(trajectory, 0, row).flow_and_slope(pixels[row], 0.3)
        np.testing.assert_allclose(flow[row], alone[0], atol=1e-4)
        np.testing.assert_allclose(slope[row], alone[1], atol=1e-3)
