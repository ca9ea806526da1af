"""Cameras against pycolmap itself, both pixel origins, and round trips."""

import numpy as np
import pycolmap
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from geometry.camera import Camera
from geometry.errors import BadInputError

CAMERAS = [
    Camera.pinhole(640, 480, 560.0),
    Camera(model="SIMPLE_PINHOLE", width=640, height=480, params=(500.0, 321.0, 236.5)),
    Camera(model="SIMPLE_RADIAL", width=640, height=480, params=(560.0, 318.0, 240.0, -0.05)),
    Camera(model="RADIAL", width=641, height=481, params=(560.0, 318.0, 240.0, -0.05, 0.01)),
    Camera(
        model="OPENCV",
        width=640,
        height=480,
        params=(560.0, 555.0, 310.0, 241.0, 0.05, -0.02, 0.001, -0.002),
    ),
    Camera(
        model="OPENCV_FISHEYE",
        width=640,
        height=480,
        params=(400.0, 405.0, 310.0, 241.0, 0.01, -0.002, 0.001, 0.0),
    ),
]
cameras = pytest.mark.parametrize("camera", CAMERAS, ids=lambda camera: camera.model)


@cameras
def test_pixel_origins_are_half_a_pixel_apart(camera: Camera) -> None:
    points = np.random.default_rng(0).uniform([-1, -0.8, 2], [1, 0.8, 4], size=(50, 3))
    colmap = camera.to_colmap()
    np.testing.assert_allclose(
        camera.project(points), np.asarray(colmap.img_from_cam(points)) - 0.5, atol=1e-9
    )
    for index, shift in zip(colmap.principal_point_idxs(), (0.5, 0.5), strict=True):
        assert colmap.params[index] == pytest.approx(camera.params[index] + shift)


@cameras
def test_rays_and_pixels_are_inverse(camera: Camera) -> None:
    pixels = np.random.default_rng(1).uniform([5, 5], [630, 470], size=(4, 30, 2))
    rays = camera.rays(pixels)
    np.testing.assert_allclose(np.linalg.norm(rays, axis=-1), 1)
    np.testing.assert_allclose(camera.project(3.7 * rays), pixels, atol=1e-5)


@cameras
def test_survives_colmap_and_json(camera: Camera) -> None:
    assert Camera.from_dict(camera.to_dict()) == camera
    back = Camera.from_colmap(camera.to_colmap())
    np.testing.assert_allclose(back.params, camera.params, atol=1e-12)
    assert (back.model, back.width, back.height) == (camera.model, camera.width, camera.height)


@cameras
def test_undistortion_map_reads_the_same_ray(camera: Camera) -> None:
    straight = camera.undistorted()
    where = camera.undistortion_map()[100:380:40, 100:540:40]
    pixels = straight.pixel_grid()[100:380:40, 100:540:40]
    assert straight.is_pinhole
    np.testing.assert_allclose(camera.rays(where), straight.rays(pixels), atol=1e-6)


def test_optical_axis_meets_the_middle_of_the_pixel_grid() -> None:
    camera = Camera.pinhole(640, 480, 560.0)
    np.testing.assert_allclose(camera.project([0, 0, 2.0]), [319.5, 239.5])
    np.testing.assert_allclose(camera.matrix[:2, 2], [319.5, 239.5])
    assert camera.pixel_grid()[3, 7].tolist() == [7, 3]


def test_points_behind_are_nan() -> None:
    pixels = CAMERAS[0].project([[0, 0, -1.0], [0, 0, 0.0], [0, 0, 1.0]])
    assert np.isnan(pixels[:2]).all()
    assert np.isfinite(pixels[2]).all()


@settings(deadline=None, max_examples=50)
@given(
    factor=st.sampled_from([0.25, 0.5, 2.0, 3.0]),
    x=st.floats(0, 639),
    y=st.floats(0, 479),
    which=st.integers(0, len(CAMERAS) - 1),
)
def test_scaling_keeps_rays(factor: float, x: float, y: float, which: int) -> None:
    """Pixel centres of a resized image: (x + 0.5) * factor - 0.5."""
    camera = CAMERAS[which]
    scaled = camera.scaled(factor)
    ratio = np.array([scaled.width / camera.width, scaled.height / camera.height])
    moved = (np.array([x, y]) + 0.5) * ratio - 0.5
    np.testing.assert_allclose(
        scaled.rays(moved), camera.rays([x, y]), atol=2e-6 + 2e-3 * (which == 3)
    )


def test_pinhole_matrix_agrees_with_pycolmap() -> None:
    camera = Camera.pinhole(641, 480, 560.0)
    colmap = pycolmap.Camera.create_from_model_name(1, "PINHOLE", 560.0, 641, 480)
    np.testing.assert_allclose(camera.to_colmap().params, colmap.params)


@pytest.mark.parametrize(
    "block",
    [
        {"model": "NO_SUCH", "width": 2, "height": 2, "params": [1]},
        {"model": "PINHOLE", "width": 2, "height": 2, "params": [1, 2]},
        {"model": "PINHOLE", "width": "wide", "height": 2, "params": [1, 2, 3, 4]},
        {"model": "PINHOLE", "width": float("inf"), "height": 2, "params": [1, 2, 3, 4]},
        {"model": "PINHOLE", "width": 0, "height": 2, "params": [1, 2, 3, 4]},
        {"model": "PINHOLE", "width": 2, "height": -2, "params": [1, 2, 3, 4]},
        {"model": "PINHOLE", "width": 2, "height": 2, "params": [1, 0, 3, 4]},
        {"model": "PINHOLE", "width": 2, "height": 2, "params": [-1, 2, 3, 4]},
        {"model": "PINHOLE", "width": 2, "height": 2, "params": [1, 2, float("nan"), 4]},
        {"model": "SIMPLE_RADIAL", "width": 2, "height": 2, "params": [1, 2, 3, float("inf")]},
        {"model": "EQUIRECTANGULAR", "width": 4, "height": 2, "params": [4, 2]},
        {"width": 2},
        {},
    ],
)
def test_bad_blocks_are_refused_in_one_line(block: dict) -> None:
    with pytest.raises(BadInputError) as caught:
        Camera.from_dict(block)
    assert "\n" not in str(caught.value)
