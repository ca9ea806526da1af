from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from geometry.arrays import FloatArray
from geometry.sfm.gauge import MAX_SLOPE_DEG, normalising_transform
from geometry.trajectory import Trajectory
from locate.simulation.evidence import orbit_trajectory

DISTANCE_M = 8.5


def plane_points(count: int, slope_deg: float) -> FloatArray:
    """Points of a plane that rises away from the cameras."""
    rng = np.random.default_rng(3)
    x, y = rng.uniform(-3, 3, (2, count))
    return np.column_stack([x, y, y * np.tan(np.radians(slope_deg))])


def tilt_deg(trajectory: Trajectory, points: FloatArray) -> tuple[float, str]:
    """How far the Z of the scene is off the true one, and what it was taken from."""
    scene_from_world, source = normalising_transform(trajectory, points, DISTANCE_M)
    return float(np.degrees(np.arccos(min(1.0, scene_from_world.rotation[2, 2])))), source


def rolled(trajectory: Trajectory, rolls_rad: FloatArray) -> Trajectory:
    """The same cameras turned about their viewing directions."""
    turns = Rotation.from_rotvec(np.outer(rolls_rad, [0, 0, 1])).as_matrix()
    return replace(
        trajectory,
        rotations=turns @ trajectory.rotations,
        translations=(turns @ trajectory.translations[..., None])[..., 0],
    )


@pytest.mark.parametrize("slope_deg", [25.0, 33.0])
def test_a_slope_of_most_points_is_not_the_ground(slope_deg: float) -> None:
    points = np.concatenate([plane_points(400, slope_deg), plane_points(100, 0.0)])
    off_deg, source = tilt_deg(orbit_trajectory(12, 60, height_m=4.0), points)
    assert off_deg < 2
    assert source == "plane"


def test_of_two_gentle_planes_the_one_nearer_to_level_is_the_ground() -> None:
    points = np.concatenate([plane_points(400, 8.0), plane_points(200, 1.0)])
    off_deg, source = tilt_deg(orbit_trajectory(12, 60, height_m=4.0), points)
    assert off_deg < 2
    assert source == "plane"


def test_cameras_show_up_where_no_ground_is_seen() -> None:
    off_deg, source = tilt_deg(orbit_trajectory(12, 60, height_m=4.0), plane_points(400, 28.0))
    assert off_deg < 0.1
    assert source == "level"


def test_a_gentle_slope_counts_as_ground() -> None:
    slope_deg = 0.6 * MAX_SLOPE_DEG
    off_deg, source = tilt_deg(orbit_trajectory(12, 60), plane_points(400, slope_deg))
    assert off_deg == pytest.approx(slope_deg, abs=0.1)
    assert source == "plane"


def test_cameras_that_roll_show_no_up() -> None:
    rolling = rolled(orbit_trajectory(12, 30), np.resize([0.4, -0.4], 12))
    off_deg, source = tilt_deg(rolling, plane_points(400, 20.0))
    assert off_deg == pytest.approx(20, abs=0.5)
    assert source == "plane"


def test_cameras_on_their_side_show_no_up() -> None:
    on_side = rolled(orbit_trajectory(12, 60), np.full(12, np.pi / 2))
    off_deg, source = tilt_deg(on_side, plane_points(5, 0.0))
    assert off_deg > 60
    assert source == "camera"
