"""Camera poses from and to the files that other tools use.

Lists of TUM, EuRoC and KITTI (`geometry.pose_lists`), COLMAP models, and transforms.json of
nerfstudio and instant-ngp, whose cameras look along -z with y up (OpenGL) and whose principal
point counts from the image corner.
"""

import json
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pycolmap
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from geometry.arrays import FloatArray
from geometry.camera import Camera
from geometry.colmap_files import read_colmap_model
from geometry.errors import BadInputError
from geometry.json_values import as_numbers
from geometry.lens_terms import merge_cameras, read_transforms_camera, write_camera_block
from geometry.named_poses import NamedPoses
from geometry.pose_lists import read_pose_list
from geometry.text_files import read_json
from geometry.trajectory import Trajectory

MAX_SKEW = 0.01
"""Largest element of R R^T - I of a matrix that counts as a rotation."""
OPENCV_FROM_OPENGL = np.diag([1.0, -1.0, -1.0])


def read_named_poses(path: Path, camera: Camera | None = None) -> NamedPoses:
    """Reads poses from a file or folder; the kind is recognised by its content.

    Args:
        path: A list of TUM, EuRoC or KITTI, a COLMAP model folder, transforms.json,
            trajectory.json or truth.json.
        camera: For lists, which have none; elsewhere it replaces the file's own.

    Raises:
        BadInputError: Nothing there that is a list of poses, or a camera is missing.
    """
    if not path.exists():
        raise BadInputError(f"{path}: no such file or folder")
    found = _read_by_kind(path, camera)
    try:
        found.trajectory.check_range()
    except BadInputError as error:
        raise BadInputError(f"{path}: {error}") from error
    return found


def _read_by_kind(path: Path, camera: Camera | None) -> NamedPoses:
    if path.is_dir():
        return _read_colmap(path, camera)
    if path.suffix.lower() != ".json":
        return _read_list(path, camera)
    content = read_json(path)
    if isinstance(content, dict) and "schema" not in content:
        return _read_transforms(path, content, camera)
    found = Trajectory.load(path)
    if camera is not None:
        found = replace(found, camera=camera)
    unnamed = ("",) * len(found)
    return NamedPoses(trajectory=found, names=unnamed, path=path, has_times=True, has_indices=True)


def read_poses(path: Path, camera: Camera | None = None) -> Trajectory:
    """The poses of `read_named_poses` without their names."""
    return read_named_poses(path, camera).trajectory


def write_tum(trajectory: Trajectory, path: Path) -> None:
    """Writes a TUM trajectory; the camera and the covariances have no place in it."""
    quaternions = _world_from_cam(trajectory).as_quat()
    rows = np.column_stack([trajectory.times_s, trajectory.centers_in_world, quaternions])
    np.savetxt(path, rows, fmt="%.17g", header="timestamp tx ty tz qx qy qz qw")


def write_colmap_model(
    trajectory: Trajectory,
    points_in_world: ArrayLike,
    folder: Path,
    names: Sequence[str] | None = None,
) -> None:
    """Writes a binary COLMAP model; its points have no tracks.

    Args:
        trajectory: The poses and the camera.
        points_in_world: (M, 3).
        folder: Made where it is missing.
        names: Image names; ``{index:06d}.png`` by default.
    """
    model = pycolmap.Reconstruction()
    camera = trajectory.camera.to_colmap(camera_id=1)
    model.add_camera_with_trivial_rig(camera)
    for i, name in enumerate(names or _default_names(trajectory)):
        pose = pycolmap.Rigid3d(
            pycolmap.Rotation3d(trajectory.rotations[i]), trajectory.translations[i]
        )
        image = pycolmap.Image(name=name, camera_id=1, image_id=i + 1)
        model.add_image_with_trivial_frame(image, pose)
    for point in np.asarray(points_in_world, dtype=float).reshape(-1, 3):
        model.add_point3D(point, pycolmap.Track())
    folder.mkdir(parents=True, exist_ok=True)
    model.write(folder)


def write_transforms_json(
    trajectory: Trajectory, path: Path, names: Sequence[str] | None = None
) -> None:
    """Writes a transforms.json.

    Raises:
        BadInputError: The camera model has no counterpart there.
    """
    rotations = np.swapaxes(trajectory.rotations, 1, 2) @ OPENCV_FROM_OPENGL
    matrices = np.tile(np.eye(4), (len(trajectory), 1, 1))
    matrices[:, :3, :3] = rotations
    matrices[:, :3, 3] = trajectory.centers_in_world
    named = zip(names or _default_names(trajectory), matrices, strict=True)
    frames = [{"file_path": name, "transform_matrix": m.tolist()} for name, m in named]
    path.write_text(
        json.dumps({**write_camera_block(trajectory.camera), "frames": frames}, indent=1)
    )


def _default_names(trajectory: Trajectory) -> list[str]:
    """``{index:06d}.png`` of every frame."""
    return [f"{index:06d}.png" for index in trajectory.indices]


def _world_from_cam(trajectory: Trajectory) -> Rotation:
    return Rotation.from_matrix(trajectory.rotations).inv()


def _checked_trajectory(
    path: Path, camera: Camera, rotations: FloatArray, translations: FloatArray
) -> Trajectory:
    if not (np.isfinite(rotations).all() and np.isfinite(translations).all()):
        raise BadInputError(f"{path}: holds a pose whose numbers are not all finite")
    turned = (np.abs(rotations) <= 1 + MAX_SKEW).all()  # the squares of others may overflow
    if not turned or not np.allclose(
        rotations @ np.swapaxes(rotations, 1, 2), np.eye(3), atol=MAX_SKEW
    ):
        raise BadInputError(f"{path}: holds a pose whose rotation is not one (skewed or scaled)")
    if (np.linalg.det(rotations) < 0).any():
        raise BadInputError(f"{path}: holds a pose whose rotation is not one (mirrored)")
    count = np.arange(len(rotations))
    return Trajectory(
        camera=camera,
        indices=count,
        times_s=count.astype(float),
        rotations=rotations,
        translations=translations,
    )


def _read_list(path: Path, camera: Camera | None) -> NamedPoses:
    if camera is None:
        raise BadInputError(f"{path}: a list of poses has no camera; give one with --camera")
    listed = read_pose_list(path)
    translations = -np.einsum("nij,nj->ni", listed.rotations, listed.centers)
    found = _checked_trajectory(path, camera, listed.rotations, translations)
    stamped = found if listed.times_s is None else replace(found, times_s=listed.times_s)
    return NamedPoses(
        trajectory=stamped,
        names=("",) * len(found),
        path=path,
        has_times=listed.times_s is not None,
        has_indices=listed.times_s is None,
    )


def _read_colmap(folder: Path, camera: Camera | None) -> NamedPoses:
    model = read_colmap_model(folder)
    try:
        images = sorted((model.image(i) for i in model.reg_image_ids()), key=lambda one: one.name)
        poses = [image.cam_from_world() for image in images]
        own = camera or merge_cameras(
            (image.name, Camera.from_colmap(model.camera(image.camera_id))) for image in images
        )
    except BadInputError as error:
        raise BadInputError(f"{folder}: {error}") from error
    except (ValueError, RuntimeError, LookupError, MemoryError) as error:
        raise BadInputError(f"{folder}: not a whole COLMAP model; export it again") from error
    rotations = np.array([pose.rotation.matrix() for pose in poses]).reshape(-1, 3, 3)
    translations = np.array([pose.translation for pose in poses]).reshape(-1, 3)
    names = tuple(image.name for image in images)
    found = _checked_trajectory(folder, own, rotations, translations)
    return NamedPoses(trajectory=found, names=names, path=folder)


def _read_transforms(path: Path, content: dict[str, Any], camera: Camera | None) -> NamedPoses:
    try:
        frames = sorted(content["frames"], key=lambda frame: str(frame["file_path"]))
        names = tuple(str(frame["file_path"]) for frame in frames)
        own = camera or read_transforms_camera(content, frames)
        without = [frame for frame in frames if frame.get("transform_matrix") is None]
        if without:
            raise BadInputError(f"{without[0]['file_path']} has no transform_matrix; remove it")
        matrices = as_numbers([frame["transform_matrix"] for frame in frames], "transform_matrix")
        if not np.isfinite(matrices).all():
            raise BadInputError("holds a pose whose numbers are not all finite")
        if matrices.shape[1] == 4 and not (np.abs(matrices[:, 3] - [0, 0, 0, 1]) < MAX_SKEW).all():
            raise BadInputError("the last row of a transform_matrix is not 0 0 0 1 (transposed?)")
        rotations = OPENCV_FROM_OPENGL @ np.swapaxes(matrices[:, :3, :3], 1, 2)
        translations = -np.einsum("nij,nj->ni", rotations, matrices[:, :3, 3])
    except BadInputError as error:
        raise BadInputError(f"{path}: {error}") from error
    except (KeyError, TypeError, ValueError, IndexError, AttributeError, ArithmeticError) as error:
        raise BadInputError(f"{path}: not a readable transforms.json ({error!r})") from error
    return NamedPoses(
        trajectory=_checked_trajectory(path, own, rotations, translations), names=names, path=path
    )
