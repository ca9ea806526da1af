"""A set of real photos with known poses, to render plumes onto."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple, Self

import cv2
import numpy as np
from scipy.spatial.transform import Rotation

from geometry.arrays import FloatArray, GreyImage
from geometry.camera import Camera
from geometry.colmap_files import read_colmap_model
from geometry.errors import BadInputError
from geometry.image_files import read_image
from geometry.named_paths import is_there
from geometry.named_poses import resize_camera
from geometry.pose_files import read_named_poses
from geometry.similarity import Similarity
from geometry.text_files import read_text
from geometry.trajectory import Trajectory

UNTURNED = cv2.IMREAD_GRAYSCALE | cv2.IMREAD_IGNORE_ORIENTATION
COLMAP_FOLDERS = (".", "sparse/0", "sparse", "colmap_ground_truth", "sfm/model")
IMAGE_FOLDERS = ("images", "images_half", "frames", ".")


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

        A folder that `locate run` wrote is one, too.

        Raises:
            BadInputError: There is none of the three, or it is broken, or the photos are missing.
        """
        if not folder.is_dir():
            raise BadInputError(f"{folder}: not a folder of posed photos")
        names, trajectory, points = _read_poses(folder)
        if not names:
            raise BadInputError(f"{folder}: its poses name no photo")
        trajectory = replace(
            trajectory, indices=np.arange(len(names)), times_s=np.zeros(len(names))
        )
        turn = Similarity(
            scale=1.0, rotation=_turn_upright(trajectory.rotations), translation=np.zeros(3)
        )
        return cls(
            paths=tuple(_find_photo(folder, name) for name in names),
            trajectory=trajectory.transformed(turn),
            points_in_world=turn(points),
            target_from_photos=turn,
        )

    def read_image(self, i: int) -> GreyImage:
        """Photo `i` in grey, of the size of its camera.

        Raises:
            BadInputError: It cannot be read, or has another size.
        """
        image = read_image(self.paths[i], UNTURNED)
        camera = self.trajectory.camera
        if image.shape != (camera.height, camera.width):
            raise BadInputError(
                f"{self.paths[i]}: {image.shape[1]}x{image.shape[0]} px, its poses say "
                f"{camera.width}x{camera.height}"
            )
        return image


class _PosedNames(NamedTuple):
    """Names and poses of N photos, and (M, 3) sparse points where the source has any."""

    names: tuple[str, ...]
    trajectory: Trajectory
    points_in_world: FloatArray


def _read_poses(folder: Path) -> _PosedNames:
    if model := _colmap_folder(folder):
        named = read_named_poses(model)
        points = read_colmap_model(model).points3D.values()
        xyz = np.array([point.xyz for point in points]).reshape(-1, 3)
        return _PosedNames(named.names, named.trajectory, xyz)
    if any(folder.rglob("*.camera")):
        return _read_strecha(folder)
    if (path := folder / "transforms.json").exists():
        return _read_transforms(path)
    raise BadInputError(
        f"{folder}: no poses (expected a COLMAP model, .camera files or transforms.json)"
    )


def _read_transforms(path: Path) -> _PosedNames:
    """Leaves out the poses without a photo, as such files list frames that were dropped."""
    named = read_named_poses(path)
    rows = [i for i, name in enumerate(named.names) if is_there(path.parent / name)]
    names = tuple(named.names[i] for i in rows)
    return _PosedNames(names, named.trajectory.take(rows), np.empty((0, 3)))


def _find_photo(folder: Path, name: str) -> Path:
    for place in IMAGE_FOLDERS:
        if is_there(path := folder / place / name):
            return path
    raise BadInputError(f"{folder}: photo {name} is missing (not in {', '.join(IMAGE_FOLDERS)})")


def _colmap_folder(folder: Path) -> Path | None:
    places = (folder / place for place in COLMAP_FOLDERS)
    kinds = ("cameras.bin", "cameras.txt")
    return next((p for p in places if any((p / kind).exists() for kind in kinds)), None)


def _read_strecha(folder: Path) -> _PosedNames:
    paths = sorted(folder.rglob("*.camera"))
    numbers = np.array([_camera_numbers(path) for path in paths])
    names = tuple(path.name.removesuffix(".camera") for path in paths)
    K, width, height = numbers[0, :9].reshape(3, 3), int(numbers[0, 24]), int(numbers[0, 25])
    params = (float(K[0, 0]), float(K[1, 1]), float(K[0, 2]), float(K[1, 2]))
    full = Camera(model="PINHOLE", width=width, height=height, params=params)
    rotations = np.swapaxes(numbers[:, 12:21].reshape(-1, 3, 3), 1, 2)
    trajectory = Trajectory(
        camera=resize_camera(full, *_photo_size(_find_photo(folder, names[0]))),
        indices=np.arange(len(names)),
        times_s=np.zeros(len(names)),
        rotations=rotations,
        translations=-np.einsum("nij,nj->ni", rotations, numbers[:, 21:24]),
        metric=True,
    )
    return _PosedNames(names, trajectory, np.empty((0, 3)))


def _camera_numbers(path: Path) -> FloatArray:
    """The 26 numbers of a .camera file: K, distortion, world_from_cam, centre, width, height."""
    try:
        numbers = np.array(read_text(path).split(), dtype=float)
    except ValueError as error:
        raise BadInputError(f"{path}: not a readable .camera file ({error})") from error
    if len(numbers) != 26:
        raise BadInputError(f"{path}: not a .camera file (expected 26 numbers)")
    return numbers


def _photo_size(photo: Path) -> tuple[int, int]:
    height, width = read_image(photo, UNTURNED).shape
    return width, height


def _turn_upright(rotations: FloatArray) -> FloatArray:
    """The (3, 3) turn that makes Z of the signed world axis nearest to the photos' mean up."""
    up = -rotations[:, 1].mean(axis=0)
    axis = int(np.abs(up).argmax())
    upward = np.zeros(3)
    upward[axis] = np.sign(up[axis])
    turn, _ = Rotation.align_vectors([[0.0, 0.0, 1.0]], [upward])
    return np.asarray(turn.as_matrix())
