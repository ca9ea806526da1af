"""Pose files: round trips, pycolmap's own reading, foreign files, and matching to frames."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pycolmap
import pytest
from scipy.spatial.transform import Rotation

from geometry.camera import Camera
from geometry.errors import BadInputError
from geometry.pose_files import (
    NamedPoses,
    read_named_poses,
    read_poses,
    write_colmap_model,
    write_transforms_json,
    write_tum,
)
from geometry.trajectory import Trajectory

CAMERA = Camera(model="SIMPLE_RADIAL", width=640, height=480, params=(560.0, 318.0, 241.0, -0.05))


def some_poses(camera: Camera = CAMERA, n: int = 6) -> Trajectory:
    random = np.random.default_rng(0)
    return Trajectory(
        camera=camera,
        indices=np.arange(n) * 2,
        times_s=1.5e9 + np.arange(n) / 30,
        rotations=Rotation.random(n, rng=random).as_matrix(),
        translations=random.normal(size=(n, 3)),
    )


def assert_same_poses(a: Trajectory, b: Trajectory) -> None:
    np.testing.assert_allclose(a.rotations, b.rotations, atol=1e-9)
    np.testing.assert_allclose(a.centers_in_world, b.centers_in_world, atol=1e-9)


def test_tum_round_trip(tmp_path: Path) -> None:
    write_tum(some_poses(), tmp_path / "poses.txt")
    found = read_poses(tmp_path / "poses.txt", CAMERA)
    assert_same_poses(found, some_poses())
    np.testing.assert_allclose(found.times_s, some_poses().times_s, atol=1e-6)


def test_tum_line_is_position_and_xyzw_of_world_from_cam(tmp_path: Path) -> None:
    (tmp_path / "p.txt").write_text(
        "# comment\n2.5 1 2 3 0 0 0.7071067811865476 0.7071067811865476\n"
    )
    found = read_poses(tmp_path / "p.txt", CAMERA)
    np.testing.assert_allclose(found.centers_in_world, [[1, 2, 3]])
    np.testing.assert_allclose(found.rotations[0].T @ [1, 0, 0], [0, 1, 0], atol=1e-12)


@pytest.mark.parametrize("text", [False, True])
def test_colmap_round_trip(tmp_path: Path, text: bool) -> None:
    points = np.random.default_rng(1).normal(size=(9, 3))
    write_colmap_model(some_poses(), points, tmp_path / "model")
    model = pycolmap.Reconstruction(tmp_path / "model")
    if text:
        (tmp_path / "text").mkdir()
        model.write_text(tmp_path / "text")
    found = read_named_poses(tmp_path / ("text" if text else "model"))
    assert_same_poses(found.trajectory, some_poses())
    assert found.trajectory.camera == CAMERA
    assert found.names[2] == "000004.png"


def test_pycolmap_projects_what_we_wrote(tmp_path: Path) -> None:
    """Half a pixel apart, as the two origins are."""
    trajectory = some_poses()
    points = trajectory.centers_in_world[0] + trajectory.rotations[0].T @ [0.2, -0.1, 3.0]
    write_colmap_model(trajectory, points[None], tmp_path / "model")
    model = pycolmap.Reconstruction(tmp_path / "model")
    image = model.find_image_with_name("000000.png")
    theirs = image.project_point(next(iter(model.points3D.values())).xyz)
    np.testing.assert_allclose(theirs, trajectory.project(0, points) + 0.5, atol=1e-9)


@pytest.mark.parametrize(
    "camera",
    [
        CAMERA,
        Camera.pinhole(640, 480, 500.0),
        Camera(model="OPENCV_FISHEYE", width=64, height=48, params=(40, 41, 30, 25, 0.1, 0, 0, 0)),
    ],
    ids=lambda camera: camera.model,
)
def test_transforms_round_trip(tmp_path: Path, camera: Camera) -> None:
    write_transforms_json(some_poses(camera), tmp_path / "transforms.json")
    found = read_named_poses(tmp_path / "transforms.json")
    rays = np.random.default_rng(2).uniform([-0.3, -0.3, 1], [0.3, 0.3, 1], size=(20, 3))
    assert_same_poses(found.trajectory, some_poses(camera))
    np.testing.assert_allclose(found.trajectory.camera.project(rays), camera.project(rays))


def test_published_transforms_look_at_the_fox(shared_data: Path) -> None:
    """All cameras of the walk look at one statue: their axes nearly meet in front of them."""
    trajectory = read_poses(shared_data / "2_sfm/fox_handheld/transforms.json")
    centers, axes = trajectory.centers_in_world, trajectory.rotations[:, 2]
    across = np.eye(3) - axes[:, :, None] * axes[:, None, :]
    meeting = np.linalg.solve(across.sum(axis=0), np.einsum("nij,nj->i", across, centers))
    depths = np.einsum("nj,nj->n", meeting - centers, axes)
    assert trajectory.camera.model == "OPENCV"
    assert (depths > 0).all()


def test_trajectory_file_is_read_too(tmp_path: Path) -> None:
    some_poses().save(tmp_path / "trajectory.json")
    found = read_named_poses(tmp_path / "trajectory.json")
    assert found.has_indices
    assert_same_poses(found.trajectory, some_poses())


def test_frames_are_matched_by_name(tmp_path: Path) -> None:
    names = [f"photos/shot{i}.jpg" for i in range(6)]
    write_transforms_json(some_poses(), tmp_path / "transforms.json", names)
    found = read_named_poses(tmp_path / "transforms.json")
    sources = ["shot5.jpg", "unknown.jpg", "shot1.png"]
    matched, rows = found.match_to_frames(sources, np.array([7, 8, 9]), np.array([0.7, 0.8, 0.9]))
    assert rows.tolist() == [0, 2]
    assert matched.indices.tolist() == [7, 9]
    assert matched.times_s.tolist() == [0.7, 0.9]
    np.testing.assert_allclose(matched.rotations[0], some_poses().rotations[5], atol=1e-12)


def test_frames_are_matched_by_index(tmp_path: Path) -> None:
    some_poses().save(tmp_path / "t.json")
    found = read_named_poses(tmp_path / "t.json")
    matched, rows = found.match_to_frames(["v.mp4"] * 4, np.arange(4), np.arange(4) / 30)
    assert rows.tolist() == [0, 2]
    assert_same_poses(matched, some_poses().take([0, 1]))


def test_frames_are_matched_by_time(tmp_path: Path) -> None:
    write_tum(replace(some_poses(), times_s=np.arange(6) / 10), tmp_path / "p.txt")
    found = read_named_poses(tmp_path / "p.txt", CAMERA)
    times_s = np.array([0.101, 0.15, 0.299, 9.0])
    matched, rows = found.match_to_frames(["v.mp4"] * 4, np.arange(4), times_s)
    assert rows.tolist() == [0, 2]
    assert_same_poses(matched, some_poses().take([1, 3]))


def test_camera_follows_the_size_of_the_images(tmp_path: Path) -> None:
    some_poses().save(tmp_path / "t.json")
    found = read_named_poses(tmp_path / "t.json")
    frames = (["v"] * 3, np.array([0, 2, 4]), np.zeros(3))
    matched, _ = found.match_to_frames(*frames, size=(320, 240))
    assert matched.camera == CAMERA.scaled(0.5)
    with pytest.raises(BadInputError, match=r"t\.json: .*640x480"):
        found.match_to_frames(*frames, size=(320, 320))


def test_poses_of_another_recording_are_refused(tmp_path: Path) -> None:
    some_poses().save(tmp_path / "t.json")
    found = read_named_poses(tmp_path / "t.json")
    with pytest.raises(BadInputError, match=r"t\.json: 0 of 3 frames"):
        found.match_to_frames(["v"] * 3, np.array([101, 103, 105]), np.zeros(3))


def numbered(tmp_path: Path, first: int) -> NamedPoses:
    names = [f"images/{first + i:06d}.png" for i in range(6)]
    write_transforms_json(some_poses(), tmp_path / "transforms.json", names)
    return read_named_poses(tmp_path / "transforms.json")


@pytest.mark.parametrize("first", [0, 1])
def test_names_that_are_numbers_count_from_the_lowest_of_0_and_1(
    tmp_path: Path, first: int
) -> None:
    matched, rows = numbered(tmp_path, first).match_to_frames(
        ["v.mp4"] * 6, np.arange(6), np.arange(6) / 30
    )
    assert rows.tolist() == [0, 1, 2, 3, 4, 5]
    assert_same_poses(matched, some_poses())


def test_one_chance_name_does_not_hide_the_indices(tmp_path: Path) -> None:
    sources = ["000003.mp4", *["v.mp4"] * 5]
    matched, rows = numbered(tmp_path, 0).match_to_frames(sources, np.arange(6), np.zeros(6))
    assert len(rows) == 6
    assert_same_poses(matched, some_poses())


@pytest.mark.parametrize("value", [np.nan, np.inf])
@pytest.mark.parametrize("place", [(1, 1), (0, 3)])
def test_transforms_that_are_not_finite_are_refused(
    tmp_path: Path, place: tuple[int, int], value: float
) -> None:
    path = tmp_path / "transforms.json"
    write_transforms_json(some_poses(), path)
    content = json.loads(path.read_text())
    content["frames"][2]["transform_matrix"][place[0]][place[1]] = value
    path.write_text(json.dumps(content))
    with pytest.raises(BadInputError, match=r"transforms\.json: .*finite"):
        read_named_poses(path)


@pytest.mark.parametrize("scale", [0.0, 0.5, -1.0])
def test_transforms_that_are_no_rotation_are_refused(tmp_path: Path, scale: float) -> None:
    path = tmp_path / "transforms.json"
    write_transforms_json(some_poses(), path)
    content = json.loads(path.read_text())
    row = content["frames"][2]["transform_matrix"][0]
    row[:3] = [scale * value for value in row[:3]]
    path.write_text(json.dumps(content))
    with pytest.raises(BadInputError, match=r"transforms\.json: .*rotation"):
        read_named_poses(path)


def test_colmap_model_that_is_not_finite_is_refused(tmp_path: Path) -> None:
    poses = some_poses()
    poses.translations[3] = np.nan
    write_colmap_model(poses, np.zeros((0, 3)), tmp_path / "model")
    with pytest.raises(BadInputError, match=r"model: .*finite"):
        read_named_poses(tmp_path / "model")


@pytest.mark.parametrize(
    ("block", "message"),
    [({"fl_x": 0.0}, "focal"), ({"w": 0}, "positive")],
)
def test_bad_cameras_are_refused_by_file(tmp_path: Path, block: dict, message: str) -> None:
    path = tmp_path / "transforms.json"
    write_transforms_json(some_poses(), path)
    path.write_text(json.dumps(json.loads(path.read_text()) | block))
    with pytest.raises(BadInputError, match=rf"transforms\.json: .*{message}"):
        read_named_poses(path)


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("p.txt", "1 2 3\n"),
        ("p.txt", "some words\n"),
        ("p.txt", "0 1 2 3 0 0 0 0\n"),
        ("t.json", "{"),
        ("t.json", "[]"),
        ("t.json", '{"frames": [{"file_path": "a"}], "w": 2, "h": 2, "fl_x": 1}'),
        ("t.json", '{"frames": []}'),
    ],
)
def test_bad_files_are_refused_in_one_line(tmp_path: Path, name: str, text: str) -> None:
    (tmp_path / name).write_text(text)
    with pytest.raises(BadInputError, match=name) as caught:
        read_poses(tmp_path / name, CAMERA)
    assert "\n" not in str(caught.value)


def test_missing_things_are_named(tmp_path: Path) -> None:
    write_tum(some_poses(), tmp_path / "p.txt")
    (tmp_path / "empty").mkdir()
    with pytest.raises(BadInputError, match="--camera"):
        read_poses(tmp_path / "p.txt")
    with pytest.raises(BadInputError, match="COLMAP"):
        read_poses(tmp_path / "empty")
    with pytest.raises(BadInputError, match="no such file"):
        read_poses(tmp_path / "gone")
