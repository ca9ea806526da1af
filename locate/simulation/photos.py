"""A set of real photos with known poses, to render plumes onto."""

import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Self

import cv2
import numpy as np
import pycolmap
from scipy.spatial.transform import Rotation

from geometry.arrays import FloatArray, GreyImage
from geometry.camera import HALF_PIXEL, Camera
from geometry.errors import BadInputError
from geometry.similarity import Similarity
from geometry.trajectory import Trajectory

COLMAP_FOLDERS = (".", "sparse/0", "sparse", "colmap_ground_truth")
IMAGE_FOLDERS = ("images", "images_half", ".")
Pose = tuple[FloatArray, FloatArray]


@dataclass(frozen=True, kw_only=True)
class PhotoSet:
    """Photos of one camera with their poses.

    Attributes:
        paths: The N photos.
        trajectory: Their poses, in the photos' own world turned to have Z up.
        points_in_world: (M, 3) sparse points on the surfaces, M = 0 where there are none.
        target_from_photos: The turn that was applied to the photos' own world.
    """

    paths: tuple[Path, ...]
    trajectory: Trajectory
    points_in_world: FloatArray
    target_from_photos: Similarity

    @classmethod
    def load(cls, folder: Path) -> Self:
        """Reads a COLMAP model, Strecha's `.camera` files, or a transforms.json, with the photos.

        Raises:
            BadInputError: There is none of the three, or it is broken, or the photos are missing.
        """
        if not folder.is_dir():
            raise BadInputError(f"{folder}: not a folder of posed photos")
        names, camera, poses, points, metric = _reader(folder)(folder)
        if not names:
            raise BadInputError(f"{folder}: its poses name no photo")
        rotations = np.array([rotation for rotation, _ in poses])
        trajectory = Trajectory(
            camera=camera,
            indices=np.arange(len(names)),
            times_s=np.zeros(len(names)),
            rotations=rotations,
            translations=np.array([translation for _, translation in poses]),
            metric=metric,
        )
        turn = Similarity(scale=1.0, rotation=_upright(rotations), translation=np.zeros(3))
        return cls(
            paths=tuple(_find_photo(folder, name) for name in names),
            trajectory=trajectory.transformed(turn),
            points_in_world=turn(points),
            target_from_photos=turn,
        )

    def image(self, i: int) -> GreyImage:
        """Photo `i` in grey, of the size its camera says.

        Raises:
            BadInputError: It cannot be read, or has another size.
        """
        image = cv2.imread(str(self.paths[i]), cv2.IMREAD_GRAYSCALE | cv2.IMREAD_IGNORE_ORIENTATION)
        camera = self.trajectory.camera
        if image is None:
            raise BadInputError(f"{self.paths[i]}: not a readable photo")
        if image.shape != (camera.height, camera.width):
            raise BadInputError(
                f"{self.paths[i]}: {image.shape[1]}x{image.shape[0]} px, its poses say "
                f"{camera.width}x{camera.height}"
            )
        return np.asarray(image, dtype=np.uint8)


Content = tuple[list[str], Camera, list[Pose], FloatArray, bool]


def _reader(folder: Path) -> Callable[[Path], Content]:
    if any(_colmap_folder(folder)):
        return _read_colmap
    if any(folder.rglob("*.camera")):
        return _read_strecha
    if (folder / "transforms.json").exists():
        return _read_transforms
    raise BadInputError(
        f"{folder}: no poses (expected a COLMAP model, .camera files or transforms.json)"
    )


def _find_photo(folder: Path, name: str) -> Path:
    for place in IMAGE_FOLDERS:
        if (path := folder / place / name).is_file():
            return path
    raise BadInputError(f"{folder}: photo {name} is missing (looked in {', '.join(IMAGE_FOLDERS)})")


def _colmap_folder(folder: Path) -> list[Path]:
    return [
        folder / place
        for place in COLMAP_FOLDERS
        for kind in ("bin", "txt")
        if (folder / place / f"cameras.{kind}").exists()
    ]


def _read_colmap(folder: Path) -> Content:
    place = _colmap_folder(folder)[0]
    try:
        model = pycolmap.Reconstruction(str(place))
    except (ValueError, RuntimeError) as error:
        raise BadInputError(f"{place}: not a readable COLMAP model ({error})") from error
    if len(model.cameras) != 1:
        raise BadInputError(f"{place}: has {len(model.cameras)} cameras, one is supported")
    images = sorted(model.images.values(), key=lambda image: image.name)
    poses = [
        (np.array(pose.rotation.matrix()), np.array(pose.translation))
        for pose in (image.cam_from_world() for image in images)
    ]
    points = np.array([point.xyz for point in model.points3D.values()]).reshape(-1, 3)
    camera = Camera.from_colmap(next(iter(model.cameras.values())))
    return [image.name for image in images], camera, poses, points, False


def _read_strecha(folder: Path) -> Content:
    names, poses = [], []
    camera = None
    for path in sorted(folder.rglob("*.camera")):
        numbers = np.array(path.read_text().split(), dtype=float)
        if len(numbers) != 26:
            raise BadInputError(f"{path}: not a .camera file (expected 26 numbers)")
        name = path.name.removesuffix(".camera")
        K, world_from_cam, center = numbers[:9].reshape(3, 3), numbers[12:21], numbers[21:24]
        names.append(name)
        rotation = world_from_cam.reshape(3, 3).T
        poses.append((rotation, -rotation @ center))
        if camera is None:
            camera = _strecha_camera(_find_photo(folder, name), K, int(numbers[24]))
    assert camera is not None
    return names, camera, poses, np.empty((0, 3)), True


def _strecha_camera(photo: Path, K: FloatArray, full_width: int) -> Camera:
    image = cv2.imread(str(photo), cv2.IMREAD_GRAYSCALE)
    if image is None:
        raise BadInputError(f"{photo}: not a readable photo")
    height, width = image.shape
    scale = width / full_width
    focal = (K[0, 0] * scale, K[1, 1] * scale)
    middle = (np.array([K[0, 2], K[1, 2]]) + HALF_PIXEL) * scale - HALF_PIXEL
    return Camera(model="PINHOLE", width=width, height=height, params=(*focal, *middle.tolist()))


def _read_transforms(folder: Path) -> Content:
    path = folder / "transforms.json"
    try:
        content = json.loads(path.read_text())
        camera = Camera(
            model="OPENCV",
            width=int(content["w"]),
            height=int(content["h"]),
            params=(
                float(content["fl_x"]),
                float(content.get("fl_y", content["fl_x"])),
                float(content["cx"]) - HALF_PIXEL,
                float(content["cy"]) - HALF_PIXEL,
                *(float(content.get(name, 0)) for name in ("k1", "k2", "p1", "p2")),
            ),
        )
        frames = sorted(content["frames"], key=lambda frame: str(frame["file_path"]))
        frames = [frame for frame in frames if (folder / frame["file_path"]).is_file()]
        matrices = [np.array(frame["transform_matrix"], dtype=float) for frame in frames]
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise BadInputError(f"{path}: not a transforms.json ({error})") from error
    opencv_from_opengl = np.diag([1.0, -1.0, -1.0])
    rotations = [opencv_from_opengl @ matrix[:3, :3].T for matrix in matrices]
    poses = [(R, -R @ matrix[:3, 3]) for R, matrix in zip(rotations, matrices, strict=True)]
    return [frame["file_path"] for frame in frames], camera, poses, np.empty((0, 3)), False


def _upright(rotations: FloatArray) -> FloatArray:
    """The (3, 3) turn that makes Z of the signed world axis nearest to the photos' mean up."""
    up = -rotations[:, 1].mean(axis=0)
    axis = int(np.abs(up).argmax())
    upward = np.zeros(3)
    upward[axis] = np.sign(up[axis])
    turn, _ = Rotation.align_vectors([[0.0, 0.0, 1.0]], [upward])
    return np.asarray(turn.as_matrix())
