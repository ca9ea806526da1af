import numpy as np
import pytest

from geometry.camera import Camera
from locate.map.plume import Plume
from locate.robot.next_view import rank_poses
from locate.simulation.camera_paths import look_at

CAMERA = Camera.pinhole(320, 240, 280.0)
MIDDLE = np.array([0.0, 0.0, 1.0])


def plume(sigmas: tuple[float, float, float] = (0.05, 0.5, 0.05)) -> Plume:
    return Plume(
        id=1,
        source=np.zeros(3),
        source_covariance=np.diag(np.square(sigmas)),
        axis=np.array([0.0, 0.0, 1.0]),
        axis_sigma_rad=0.05,
        extent_low=0.0,
        extent_high=2.0,
        radius_by_height=np.array([[0.0, 0.1], [2.0, 0.3]]),
        evidence_nats=100.0,
        probability=1.0,
        views=(0, 1, 2),
        displacement_px=1.0,
    )


def pose(x: float, y: float, z: float = 1.5, *, target: np.ndarray = MIDDLE) -> np.ndarray:
    center = np.array([x, y, z])
    world_from_cam = np.eye(4)
    world_from_cam[:3, :3] = look_at(center, target).T
    world_from_cam[:3, 3] = center
    return world_from_cam


def walls(radius: float) -> np.ndarray:
    angles, heights = np.meshgrid(np.linspace(0, 2 * np.pi, 180), np.linspace(-2, 5, 40))
    return np.stack([radius * np.cos(angles), radius * np.sin(angles), heights], axis=-1).reshape(
        -1, 3
    )


def test_looks_across_the_long_axis_of_the_covariance() -> None:
    poses = [pose(0, -6), pose(6, 0), pose(4.2, -4.2)]
    ranked = rank_poses([plume()], walls(12), CAMERA, poses)
    assert [suggestion.index for suggestion in ranked] == [1, 2, 0]
    assert ranked[0].sigma_m < 0.2
    assert ranked[0].gain_m == pytest.approx(
        np.sqrt(np.trace(plume().source_covariance)) - ranked[0].sigma_m
    )


def test_what_does_not_show_the_plume_gains_nothing() -> None:
    away = pose(6, 0, target=np.array([12.0, 0, 1]))
    beside = pose(6, 0, target=np.array([0.0, 9, 1]))
    for suggestion in rank_poses([plume()], walls(12), CAMERA, [away, beside]):
        assert suggestion.gain_m == 0
        assert suggestion.displacement_px == 0


def test_background_close_behind_shows_nothing() -> None:
    near = walls(0.15)
    (suggestion,) = rank_poses([plume()], near[near[:, 0] < 0], CAMERA, [pose(6, 0)])
    far = rank_poses([plume()], walls(12), CAMERA, [pose(6, 0)])[0]
    assert suggestion.displacement_px < 0.2 * far.displacement_px
    assert suggestion.gain_m < far.gain_m


def test_covered_plume_gains_nothing() -> None:
    y, z = np.meshgrid(np.linspace(-3, 3, 60), np.linspace(-3, 4, 60))
    cover = np.stack([np.full_like(y, 3.0), y, z], axis=-1).reshape(-1, 3)
    (suggestion,) = rank_poses([plume()], np.vstack([cover, walls(12)]), CAMERA, [pose(6, 0)])
    assert suggestion.gain_m == 0


def test_all_plumes_count() -> None:
    poses = [pose(0, -6), pose(6, 0)]
    first, second = plume(), plume((0.8, 0.05, 0.05))
    both = rank_poses([first, second], walls(12), CAMERA, poses)
    assert both[0].index == 0
    alone = [rank_poses([one], walls(12), CAMERA, poses[:1])[0] for one in (first, second)]
    assert both[0].gain_m == pytest.approx(sum(suggestion.gain_m for suggestion in alone))
    assert both[0].sigma_m == max(suggestion.sigma_m for suggestion in alone)


def test_no_plume_no_preference() -> None:
    assert [s.gain_m for s in rank_poses([], walls(12), CAMERA, [pose(0, -6), pose(6, 0)])] == [
        0,
        0,
    ]
