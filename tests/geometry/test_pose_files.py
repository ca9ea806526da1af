"""Pose files: round trips, pycolmap's own reading, foreign files, and matching to frames."""

import json
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pycolmap
import pytest
from scipy.spatial.transform import Rotation

from geometry.camera import Camera
from geometry.errors import BadInputError
from geometry.named_poses import NamedPoses, read_camera
from geometry.pose_files import (
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


INTRINSICS = {"fl_x": 500, "fl_y": 500, "cx": 320, "cy": 240, "w": 640, "h": 480}
LENS = {"k1": -0.3, "k2": 0.1, "p1": 0.001, "p2": 0.002}
FISHEYE = {"k1": 0.03, "k2": 0.005, "k3": 0.0006, "k4": 0.0001}
RATIONAL = {**LENS, "k3": 0.1, "k4": 0.2, "k5": 0.1, "k6": 0.1}


def transforms_with(
    folder: Path, block: dict, own: Callable[[int], dict] = lambda _: {}
) -> Trajectory:
    """What is read of three frames with these keys for all, and their own."""
    matrix = np.eye(4).tolist()
    frames = [{"file_path": f"{i}.jpg", "transform_matrix": matrix, **own(i)} for i in range(3)]
    (folder / "transforms.json").write_text(json.dumps({**block, "frames": frames}))
    return read_poses(folder / "transforms.json")


@pytest.mark.parametrize(
    ("block", "model", "lens"),
    [
        ({**LENS, "camera_model": "OPENCV"}, "OPENCV", LENS.values()),
        ({**LENS, "camera_model": "opencv"}, "OPENCV", LENS.values()),
        (LENS, "OPENCV", LENS.values()),
        ({**LENS, "k3": 0, "is_fisheye": False}, "OPENCV", LENS.values()),
        (
            {**LENS, "k3": -0.05, "camera_model": "OPENCV"},
            "FULL_OPENCV",
            [*LENS.values(), -0.05, 0, 0, 0],
        ),
        ({**RATIONAL, "camera_model": "FULL_OPENCV"}, "FULL_OPENCV", RATIONAL.values()),
        ({**RATIONAL, "camera_model": "OPENCV"}, "FULL_OPENCV", RATIONAL.values()),
        ({**FISHEYE, "camera_model": "OPENCV_FISHEYE"}, "OPENCV_FISHEYE", FISHEYE.values()),
        ({**FISHEYE, "is_fisheye": True}, "OPENCV_FISHEYE", FISHEYE.values()),
        ({"camera_model": "OPENCV_FISHEYE"}, "OPENCV_FISHEYE", [0, 0, 0, 0]),
        ({"k1": 0.1, "camera_model": "SIMPLE_RADIAL_FISHEYE"}, "OPENCV_FISHEYE", [0.1, 0, 0, 0]),
        ({"k1": -0.2, "camera_model": "SIMPLE_RADIAL"}, "OPENCV", [-0.2, 0, 0, 0]),
        ({"k1": -0.2, "k2": 0.01, "camera_model": "RADIAL"}, "OPENCV", [-0.2, 0.01, 0, 0]),
        (
            {**LENS, "sx1": 0.01, "camera_model": "THIN_PRISM_FISHEYE"},
            "THIN_PRISM_FISHEYE",
            [*LENS.values(), 0, 0, 0.01, 0],
        ),
        ({"camera_model": "PINHOLE", "k1": 0.0}, "PINHOLE", []),
        ({"aabb_scale": 4, "applied_scale": 2.0, "sharpness": 31.0}, "PINHOLE", []),
    ],
)
@pytest.mark.parametrize("in_frames", [False, True])
def test_every_lens_of_a_transforms_json_is_read(
    tmp_path: Path, block: dict, model: str, lens: Sequence[float], in_frames: bool
) -> None:
    whole = {**INTRINSICS, **block}
    common, own = ({}, whole) if in_frames else (whole, {})
    camera = transforms_with(tmp_path, common, lambda _: own).camera
    assert camera.model == model
    assert camera.params == (500, 500, 319.5, 239.5, *lens)


@pytest.mark.parametrize(
    ("block", "word"),
    [
        ({"camera_model": "PINHOLE", "k1": -0.2}, "k1 = -0.2"),
        ({"camera_model": "SIMPLE_RADIAL", "k1": -0.2, "k2": 0.1}, "k2 = 0.1"),
        ({"camera_model": "EQUIRECTANGULAR"}, "'EQUIRECTANGULAR'"),
        ({"camera_model": "PERSPECTIVE", **LENS}, "'PERSPECTIVE'"),
        ({"camera_model": "FISHEYE624"}, "'FISHEYE624'"),
        ({"camera_model": "OPENCV", "is_fisheye": True, **FISHEYE}, "is_fisheye"),
        ({"camera_model": "OPENCV", "k4": 0.2}, "k4"),
        ({"is_fisheye": True, **LENS}, "p1"),
        ({"k7": 0.1}, "k7"),
        ({"s1": 0.1}, "s1"),
        ({"ortho": True}, "ortho"),
        ({"equirectangular": True}, "equirectangular"),
        ({"ftheta_p0": 0.1}, "ftheta_p0"),
        ({"rolling_shutter": [0, 0, 0.1, 0]}, "rolling_shutter"),
        ({"distortion_params": [0.1, 0, 0, 0]}, "distortion_params"),
        ({"fx": 501}, "fx"),
        ({"w": 640.5}, "w"),
    ],
)
@pytest.mark.parametrize("in_frames", [False, True])
def test_a_lens_that_is_not_understood_is_refused_by_name(
    tmp_path: Path, block: dict, word: str, in_frames: bool
) -> None:
    whole = {**INTRINSICS, **block}
    common, own = ({}, whole) if in_frames else (whole, {})
    with pytest.raises(BadInputError, match=rf"transforms\.json: .*{word}"):
        transforms_with(tmp_path, common, lambda _: own)


def test_focal_lengths_by_angles(tmp_path: Path) -> None:
    size = {"w": 640, "h": 480}
    camera = transforms_with(tmp_path, {**size, "camera_angle_x": 1.0}).camera
    assert camera.params[:2] == pytest.approx((585.7561, 585.7561))
    both = {**size, "camera_angle_x": 1.0, "camera_angle_y": 0.9}
    assert transforms_with(tmp_path, both).camera.params[1] == pytest.approx(496.8373)
    with pytest.raises(BadInputError, match="size of the images"):
        transforms_with(tmp_path, {"camera_angle_x": 1.0})
    with pytest.raises(BadInputError, match="fl_x"):
        transforms_with(tmp_path, {**size, "camera_angle_x": 1.0, "is_fisheye": True})


def test_intrinsics_of_each_frame_that_agree_are_one_camera(tmp_path: Path) -> None:
    def own(i: int) -> dict:
        return {"fx": 500 + 1e-4 * i, "fy": 500, "cx": 320, "cy": 240, "width": 640, "height": 480}

    assert transforms_with(tmp_path, {}, own).camera.params == (500, 500, 319.5, 239.5)


def test_intrinsics_of_each_frame_that_differ_are_refused(tmp_path: Path) -> None:
    with pytest.raises(BadInputError, match=r"of 3 cameras: .*500.5 px .*501 px"):
        transforms_with(tmp_path, INTRINSICS, lambda i: {"fl_x": 500 + i})


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"camera": {"k1": 0.1}}, "camera holds k1"),
        ({"cameras": [{"fl_x": 500.0}]}, "cameras holds fl_x"),
        ({"camera_angle_x": 1.0}, "fl_x = 500 px and camera_angle_x = 1.0, which is 585.76 px"),
        ({"cx": 3200.0}, "cx, cy = 3200, 240 px are far from the middle of 640x480"),
        ({"w": 2560, "h": 1920}, "far from the middle of 2560x1920 images"),
        ({"cx": 0.5, "cy": 0.5}, "in px"),
        ({"camera_angle_x": 0.0}, "not a readable transforms"),
    ],
)
def test_intrinsics_that_cannot_be_are_refused(
    tmp_path: Path, changes: dict[str, object], said: str
) -> None:
    lens = {"fl_x": 500.0, "cx": 320.0, "cy": 240.0, "w": 640, "h": 480} | changes
    frames = [{"file_path": "0.jpg", "transform_matrix": np.eye(4).tolist()}]
    (tmp_path / "transforms.json").write_text(json.dumps({**lens, "frames": frames}))
    with pytest.raises(BadInputError, match=said):
        read_poses(tmp_path / "transforms.json")


@pytest.mark.parametrize("row", [[3.0, 0, 0, 1], [0, 0, 0, 2.0], [0, 0, 0, 0]])
def test_transposed_matrices_are_refused(tmp_path: Path, row: list[float]) -> None:
    matrix = np.eye(4)
    matrix[3] = row
    frames = [{"file_path": "0.jpg", "transform_matrix": matrix.tolist()}]
    content = {"fl_x": 500.0, "w": 640, "h": 480, "frames": frames}
    (tmp_path / "transforms.json").write_text(json.dumps(content))
    with pytest.raises(BadInputError, match="the last row of a transform_matrix is not 0 0 0 1"):
        read_poses(tmp_path / "transforms.json")


def test_a_frame_without_a_pose_is_named(tmp_path: Path) -> None:
    with pytest.raises(BadInputError, match=r"1\.jpg has no transform_matrix"):
        transforms_with(
            tmp_path, INTRINSICS, lambda i: {"transform_matrix": None} if i == 1 else {}
        )


@pytest.mark.parametrize("zoom", [1.0, 1.2])
def test_a_colmap_model_with_a_camera_for_each_image(tmp_path: Path, zoom: float) -> None:
    """Equal ones are one camera; others are refused with their number."""
    model, poses = pycolmap.Reconstruction(), some_poses()
    for i in range(3):
        focal, *others = CAMERA.params
        own = replace(CAMERA, params=(focal * zoom ** (i // 2), *others))
        model.add_camera_with_trivial_rig(own.to_colmap(camera_id=i + 1))
        pose = pycolmap.Rigid3d(pycolmap.Rotation3d(poses.rotations[i]), poses.translations[i])
        image = pycolmap.Image(name=f"{i}.png", camera_id=i + 1, image_id=i + 1)
        model.add_image_with_trivial_frame(image, pose)
    model.write(tmp_path)
    if zoom == 1:
        assert read_poses(tmp_path).camera == CAMERA
    else:
        with pytest.raises(BadInputError, match=r"of 2 cameras: .*560 px .*672 px"):
            read_poses(tmp_path)


@pytest.mark.parametrize("key", ["k1", "distortion", "p2"])
def test_a_camera_file_with_a_lens_beside_its_params_is_refused(tmp_path: Path, key: str) -> None:
    block = {**Camera.pinhole(640, 480, 500.0).to_dict(), key: 0.1}
    (tmp_path / "camera.json").write_text(json.dumps(block))
    with pytest.raises(BadInputError, match=rf"camera\.json: .*{key} = 0\.1"):
        read_camera(tmp_path / "camera.json", 640, 480)


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


@pytest.mark.parametrize(
    "block",
    [
        {"k_1": -0.2},
        {"kappa1": -0.2},
        {"k1k2": [-0.2, 0.1]},
        {"radial": [-0.2]},
        {"D": [-0.2, 0.1, 0, 0]},
        {"K": [[510, 0, 330], [0, 510, 250], [0, 0, 1]]},
        {"coeffs": [-0.2]},
        {"coefficients": [-0.2]},
        {"center_x": 300},
        {"pixel_aspect_ratio": 1.3},
        {"poly": [1, 0.1]},
        {"a1": 0.1},
        {"lambda": -0.1},
    ],
    ids=lambda block: next(iter(block)),
)
def test_lens_terms_under_other_names_are_refused(tmp_path: Path, block: dict) -> None:
    name = next(iter(block))
    with pytest.raises(BadInputError, match=rf"{name} = .* is not understood with camera model"):
        transforms_with(tmp_path, {**INTRINSICS, **block})


def test_the_model_may_be_called_model_as_devices_are(tmp_path: Path) -> None:
    fisheye = {**INTRINSICS, "model": "opencv_fisheye", "k1": 0.01}
    assert transforms_with(tmp_path, fisheye).camera.model == "OPENCV_FISHEYE"
    assert transforms_with(tmp_path, {**INTRINSICS, "model": "FC300S"}).camera.model == "PINHOLE"
    with pytest.raises(BadInputError, match="'FTHETA' is not one of"):
        transforms_with(tmp_path, {**INTRINSICS, "model": "FTHETA"})
