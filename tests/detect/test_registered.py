from dataclasses import replace

import cv2
import numpy as np
import pytest

from detect.detection import Frames
from detect.registered import RegisteredDetector
from detect.registered.neighbours import choose_neighbours, typical_inverse_depth
from detect.scores import auroc
from geometry.errors import BadInputError
from geometry.trajectory import Trajectory
from tests.detect.scenes import TwoWalls, two_walls


def trajectory_of(frames: Frames) -> Trajectory:
    assert frames.trajectory is not None
    return frames.trajectory


def inside(scene: TwoWalls) -> np.ndarray:
    size = np.linalg.norm(scene.displacement, axis=-1)
    return size > size.max() / 2


def test_the_displacement_is_found_with_its_sign(walls_with_plume: TwoWalls) -> None:
    scene = walls_with_plume
    detection = RegisteredDetector().detect(scene.frames, scene.key)
    plume = inside(scene)
    error = np.linalg.norm(detection.displacement - scene.displacement, axis=-1)
    assert error[plume].mean() < 0.12
    gain = (detection.displacement * scene.displacement)[plume].sum() / (
        scene.displacement[plume] ** 2
    ).sum()
    assert 0.85 < gain < 1.1
    assert auroc(detection.llr, plume) > 0.95
    assert detection.llr[plume].mean() > 2


def test_the_depth_is_found_in_world_units(walls_with_plume: TwoWalls) -> None:
    scene = walls_with_plume
    detection = RegisteredDetector().detect(scene.frames, scene.key)
    assert detection.inverse_depth is not None
    error = np.abs(detection.inverse_depth * scene.depth - 1)
    assert np.nanmedian(error) < 0.005
    assert np.nanpercentile(error, 85) < 0.03


def test_still_air_gives_no_evidence(walls_without_plume: TwoWalls) -> None:
    scene = walls_without_plume
    detection = RegisteredDetector().detect(scene.frames, scene.key)
    assert np.median(np.linalg.norm(detection.displacement, axis=-1)[35:]) < 0.06
    assert (detection.llr > 1).mean() < 0.01
    assert detection.llr[35:].mean() < -0.3


def test_the_sky_says_nothing(walls_without_plume: TwoWalls) -> None:
    scene = walls_without_plume
    detection = RegisteredDetector().detect(scene.frames, scene.key)
    assert not detection.llr[:20].any()
    assert np.isinf(detection.sigma_px[:20]).mean() > 0.9


def test_the_world_unit_changes_nothing_but_the_depth(walls_with_plume: TwoWalls) -> None:
    metres = RegisteredDetector().detect(walls_with_plume.frames, walls_with_plume.key)
    scene = two_walls(peak_px=0.6, unit=1000.0)
    detection = RegisteredDetector().detect(scene.frames, scene.key)
    np.testing.assert_allclose(detection.displacement, metres.displacement, atol=0.02)
    assert metres.inverse_depth is not None
    assert detection.inverse_depth is not None
    np.testing.assert_allclose(
        np.nanmedian(detection.inverse_depth) * 1000, np.nanmedian(metres.inverse_depth), rtol=0.01
    )


def test_a_small_pose_error_costs_little(walls_with_plume: TwoWalls) -> None:
    scene = walls_with_plume
    trajectory = trajectory_of(scene.frames)
    rng = np.random.default_rng(3)
    turns = [cv2.Rodrigues(rng.normal(0, np.deg2rad(0.1), 3))[0] for _ in range(len(trajectory))]
    wrong = replace(trajectory, rotations=np.array(turns) @ trajectory.rotations)
    frames = Frames(images=scene.frames.images, trajectory=wrong)
    detection = RegisteredDetector().detect(frames, scene.key)
    error = np.linalg.norm(detection.displacement - scene.displacement, axis=-1)
    assert error[inside(scene)].mean() < 0.15
    assert auroc(detection.llr, inside(scene)) > 0.93


def test_the_first_frame_has_neighbours_on_one_side_only(walls_without_plume: TwoWalls) -> None:
    detection = RegisteredDetector().detect(walls_without_plume.frames, 0)
    assert np.isfinite(detection.sigma_px).mean() > 0.4
    assert (detection.llr > 1).mean() < 0.02


def test_neighbours_lie_on_both_sides_by_parallax(walls_without_plume: TwoWalls) -> None:
    scene = walls_without_plume
    trajectory = trajectory_of(scene.frames)
    rows = choose_neighbours(trajectory, scene.key, 1 / 12, 8)
    assert len(rows) == len(set(rows)) == 8
    assert sum(row < scene.key for row in rows) == 4
    distances = [abs(row - scene.key) for row in rows]
    assert distances == sorted(distances)


def test_b_frames_are_neighbours_where_the_others_are_too_few(
    walls_without_plume: TwoWalls,
) -> None:
    trajectory = trajectory_of(walls_without_plume.frames)
    key = walls_without_plume.key
    rows = np.arange(len(trajectory))
    b_frames = rows[rows % 2 != key % 2]
    chosen = choose_neighbours(trajectory, key, 1 / 12, 4, b_frames)
    assert len(chosen) == 4
    assert not set(chosen) & set(b_frames.tolist())
    everything = choose_neighbours(trajectory, key, 1 / 12, 4)
    assert choose_neighbours(trajectory, key, 1 / 12, 4, rows) == everything


def test_at_the_end_of_the_path_one_side_gives_them_all(walls_without_plume: TwoWalls) -> None:
    trajectory = trajectory_of(walls_without_plume.frames)
    assert len(choose_neighbours(trajectory, 0, 1 / 12, 6)) == 6
    from_the_second = choose_neighbours(trajectory, 1, 1 / 12, 6)
    assert 0 in from_the_second
    assert len(from_the_second) == 6


def test_the_typical_depth_comes_from_the_flow(walls_without_plume: TwoWalls) -> None:
    scene = walls_without_plume
    found = typical_inverse_depth(scene.frames, trajectory_of(scene.frames), scene.key)
    assert found == pytest.approx(1 / 12, rel=0.1)


def test_sparse_points_say_how_deep_the_scene_is(walls_with_plume: TwoWalls) -> None:
    scene = walls_with_plume
    points = np.array([[0.0, 0.0, 12.0], [1.0, 0.5, 12.0], [2.6, 0.0, 7.0], [0.0, 0.0, -5.0]])
    detection = RegisteredDetector(points_in_world=points).detect(scene.frames, scene.key)
    error = np.linalg.norm(detection.displacement - scene.displacement, axis=-1)
    assert error[inside(scene)].mean() < 0.12


def test_without_poses_it_points_to_bos(walls_with_plume: TwoWalls) -> None:
    frames = Frames(images=walls_with_plume.frames.images)
    with pytest.raises(BadInputError, match="use bos"):
        RegisteredDetector().detect(frames, 0)


def test_frames_and_poses_must_agree(walls_with_plume: TwoWalls) -> None:
    frames = replace(walls_with_plume.frames, images=walls_with_plume.frames.images[:5])
    with pytest.raises(BadInputError, match="5 frames but 13 poses"):
        RegisteredDetector().detect(frames, 0)


def test_a_frame_without_neighbours_says_nothing(walls_without_plume: TwoWalls) -> None:
    trajectory = trajectory_of(walls_without_plume.frames)
    rotations = trajectory.rotations.copy()
    rotations[0] = rotations[0] @ cv2.Rodrigues(np.array([0.0, 1.5, 0.0]))[0]
    frames = Frames(
        images=walls_without_plume.frames.images,
        trajectory=replace(trajectory, rotations=rotations),
    )
    detection = RegisteredDetector(points_in_world=np.array([[-99.0, 0, 12]])).detect(frames, 0)
    assert not detection.llr.any()
    assert np.isinf(detection.sigma_px).all()


def test_a_still_camera_has_no_parallax(walls_without_plume: TwoWalls) -> None:
    trajectory = trajectory_of(walls_without_plume.frames)
    still = replace(
        trajectory,
        rotations=np.repeat(trajectory.rotations[:1], len(trajectory), axis=0),
        translations=np.zeros_like(trajectory.translations),
    )
    images = [walls_without_plume.frames.images[0]] * len(trajectory)
    with pytest.raises(BadInputError, match="parallax"):
        RegisteredDetector().detect(Frames(images=images, trajectory=still), 6)
