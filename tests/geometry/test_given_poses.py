"""Given poses against rendered images: which are confirmed, doubted, refused."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from geometry.arrays import IntArray
from geometry.camera import Camera
from geometry.errors import BadInputError
from geometry.sfm.given_poses import angles_to_arcs, check_given_poses, measure_support
from geometry.trajectory import Trajectory
from tests.geometry.test_sfm import FOCAL, HEIGHT, ROOM, WIDTH, look_at, render

COUNT = 12


@pytest.fixture(scope="module")
def walk() -> Trajectory:
    angles = np.radians(np.linspace(-35, 35, COUNT))
    eyes = np.column_stack([9 * np.sin(angles), 6 - 9 * np.cos(angles), 2 + 0.8 * angles**2])
    poses = [look_at(eye, np.array([0.0, 2.0, 1.0])) for eye in eyes]
    return Trajectory(
        camera=Camera.pinhole(WIDTH, HEIGHT, FOCAL),
        indices=np.arange(COUNT),
        times_s=np.arange(COUNT) / 5,
        rotations=np.array([rotation for rotation, _ in poses]),
        translations=np.array([translation for _, translation in poses]),
    )


@pytest.fixture(scope="module")
def images(walk: Trajectory) -> list[np.ndarray]:
    poses = zip(walk.rotations, walk.translations, strict=True)
    return [render(ROOM, rotation, translation) for rotation, translation in poses]


def reordered(walk: Trajectory, rows: IntArray) -> Trajectory:
    return replace(walk, rotations=walk.rotations[rows], translations=walk.translations[rows])


def test_true_poses_are_confirmed(walk: Trajectory, images: list[np.ndarray]) -> None:
    assert check_given_poses(walk, images) == ()
    found = measure_support(walk, images)
    assert found.pairs >= 5
    assert found.share > 0.95


@pytest.mark.parametrize(
    "rows",
    [
        np.random.default_rng(0).permutation(COUNT),
        np.arange(COUNT)[::-1],
        np.arange(COUNT) * 5 % COUNT,
        np.zeros(COUNT, dtype=int),
    ],
    ids=["shuffled", "reversed", "every fifth", "all the first"],
)
def test_poses_of_other_frames_are_refused(
    walk: Trajectory, images: list[np.ndarray], rows: IntArray
) -> None:
    with pytest.raises(BadInputError, match=r"explain only \d+% of the matches"):
        check_given_poses(reordered(walk, rows), images)


def test_other_axes_and_directions_are_refused(walk: Trajectory, images: list[np.ndarray]) -> None:
    flip = np.diag([1.0, -1.0, -1.0])
    opengl = replace(walk, rotations=flip @ walk.rotations, translations=walk.translations @ flip)
    inverse = replace(
        walk,
        rotations=np.swapaxes(walk.rotations, 1, 2),
        translations=walk.centers_in_world,
    )
    for wrong in (opengl, inverse):
        with pytest.raises(BadInputError, match="turned otherwise"):
            check_given_poses(wrong, images)


@pytest.mark.parametrize(("factor", "said"), [(0.9, "longer"), (1.11, "shorter")])
def test_a_focal_length_that_is_somewhat_off_is_doubted(
    walk: Trajectory, images: list[np.ndarray], factor: float, said: str
) -> None:
    camera = Camera.pinhole(WIDTH, HEIGHT, FOCAL * factor)
    (note,) = check_given_poses(replace(walk, camera=camera), images)
    assert f"camera is doubtful: with a focal length about 10% {said}" in note


@pytest.mark.parametrize(("factor", "said"), [(0.75, "longer"), (1.4, "shorter")])
def test_a_focal_length_of_another_zoom_is_refused(
    walk: Trajectory, images: list[np.ndarray], factor: float, said: str
) -> None:
    camera = Camera.pinhole(WIDTH, HEIGHT, FOCAL * factor)
    with pytest.raises(BadInputError, match=rf"about \d\d% {said} .* another camera, zoom"):
        check_given_poses(replace(walk, camera=camera), images)


def test_the_frame_of_the_world_does_not_matter(walk: Trajectory, images: list[np.ndarray]) -> None:
    turn = Rotation.from_rotvec([0.3, -1.0, 2.0]).as_matrix()
    turned = replace(walk, rotations=walk.rotations @ turn, translations=40 * walk.translations)
    assert check_given_poses(turned, images) == ()


@pytest.mark.parametrize("grey", [0, 128])
def test_where_too_little_matches_a_note_says_so(walk: Trajectory, grey: int) -> None:
    blank = [np.full((HEIGHT, WIDTH), grey, np.uint8)] * COUNT
    (note,) = check_given_poses(walk, blank)
    assert "could not be held against the images" in note


def test_frames_that_hardly_move_say_nothing(walk: Trajectory, images: list[np.ndarray]) -> None:
    (note,) = check_given_poses(walk, [images[0]] * COUNT)
    assert "could not be held against the images" in note


def test_a_point_is_seen_between_far_away_and_the_other_camera(walk: Trajectory) -> None:
    points = np.array([[0.0, 2.0, 1.0], [0.5, 3.0, 0.2]])
    rays = [(points @ walk.rotations[row].T + walk.translations[row]) for row in (0, 7)]
    first, second = (ray / np.linalg.norm(ray, axis=1, keepdims=True) for ray in rays)
    np.testing.assert_allclose(angles_to_arcs(walk, 0, 7, first, second), 0, atol=1e-7)
    far = first @ walk.rotations[0] @ walk.rotations[7].T
    axis = np.cross(second, far)
    axis /= np.linalg.norm(axis, axis=1, keepdims=True)
    beyond = Rotation.from_rotvec(0.05 * axis).apply(far)  # on the line, behind infinity
    np.testing.assert_allclose(angles_to_arcs(walk, 0, 7, first, beyond), 0.05, atol=1e-6)
