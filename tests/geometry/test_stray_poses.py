"""Poses that lie far off their path are found, and no others."""

from dataclasses import replace

import numpy as np
import pytest

from geometry.stray_poses import stray_rows
from geometry.trajectory import Trajectory
from locate.simulation.evidence import orbit_trajectory


def with_centers(centers: np.ndarray) -> Trajectory:
    path = orbit_trajectory(len(centers), 40)
    return replace(path, translations=-np.einsum("nij,nj->ni", path.rotations, centers))


def arc(count: int = 40) -> np.ndarray:
    return orbit_trajectory(count, 60).centers_in_world


def test_two_poses_that_changed_places_are_both_strays() -> None:
    centers = arc()
    centers[[7, 30]] = centers[[30, 7]]
    assert stray_rows(with_centers(centers)).tolist() == [7, 30]


def test_a_pose_far_away_is_a_stray() -> None:
    centers = arc()
    centers[12] += [0, 0, 4]
    assert stray_rows(with_centers(centers)).tolist() == [12]


@pytest.mark.parametrize("seed", range(3))
def test_a_smooth_a_shaken_and_an_uneven_path_have_none(seed: int) -> None:
    rng = np.random.default_rng(seed)
    smooth = arc(200)
    shaken = smooth + rng.normal(0, 0.05, smooth.shape)
    uneven = smooth[np.unique(rng.integers(0, 200, 40))]
    there_and_back = np.concatenate([smooth, smooth[::-1]])
    for path in (smooth, shaken, uneven, there_and_back, smooth[:2]):
        assert not len(stray_rows(with_centers(path)))
