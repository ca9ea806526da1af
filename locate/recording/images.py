"""The frames of a run, read and undistorted on demand."""

from collections import OrderedDict
from collections.abc import Sequence
from pathlib import Path
from typing import overload

import cv2
import numpy as np
from numpy.typing import NDArray

from detect.warp import sample
from geometry.arrays import FloatMap, GreyImage
from geometry.atomic import atomic_path
from geometry.camera import Camera
from geometry.errors import BadInputError
from geometry.stretch import Samples, Stretch, as_samples, deep_samples
from locate.recording.decoders import decode_samples

CACHED = 24
"""Images kept in memory."""
INVISIBLE_PX = 0.05
"""Distortion below which an image counts as undistorted, px."""


class FrameImages(Sequence[GreyImage]):
    """Grey images from files, seen by a pinhole camera; the last `CACHED` stay in memory.

    Args:
        paths: The files.
        camera: That took them; None where it is unknown, then nothing is undistorted.
        stretch: Of their recording, for deep samples.
    """

    def __init__(
        self,
        paths: Sequence[Path],
        camera: Camera | None = None,
        stretch: Stretch | None = None,
    ) -> None:
        self._paths = list(paths)
        self._stretch = stretch
        self._map = None if camera is None else distortion_map(camera)
        self._cache: OrderedDict[int, GreyImage] = OrderedDict()

    def __len__(self) -> int:
        return len(self._paths)

    @overload
    def __getitem__(self, i: int) -> GreyImage: ...
    @overload
    def __getitem__(self, i: slice) -> "FrameImages": ...
    def __getitem__(self, i: int | slice) -> "GreyImage | FrameImages":
        if isinstance(i, slice):
            part = FrameImages(self._paths[i], stretch=self._stretch)
            part._map = self._map
            return part
        if i not in self._cache:
            self._cache[i] = self._read_image(self._paths[i])
            if len(self._cache) > CACHED:
                self._cache.popitem(last=False)
        self._cache.move_to_end(i)
        return self._cache[i]

    def _read_image(self, path: Path) -> GreyImage:
        if not path.exists():
            raise BadInputError(f"{path}: is gone; in a run folder, repeat the run with --force")
        image = read_grey(path, self._stretch)
        if self._map is not None:
            image = np.rint(sample(image, self._map)).clip(0, 255).astype(np.uint8)
        return image


def read_grey(path: Path, stretch: Stretch | None = None) -> GreyImage:
    """An image file in grey: colour is weighted, alpha ignored, EXIF's turn of it obeyed.

    Args:
        path: The file.
        stretch: Of the recording, for deep samples; without one it is chosen from the file.

    Raises:
        BadInputError: See `read_samples`.
    """
    return show_in_grey(read_samples(path), stretch)


def show_in_grey(samples: Samples, stretch: Stretch | None = None) -> GreyImage:
    """The (H, W) image of 8 bits that `read_grey` gives of these samples."""
    deep = deep_samples(samples)
    if deep is None:
        return np.asarray(samples, dtype=np.uint8)
    scale = stretch or Stretch.choose([deep])
    return np.zeros(deep.shape, np.uint8) if scale is None else scale.apply(deep)


def read_samples(path: Path) -> Samples:
    """The (H, W) samples of an image file in grey, as deep as they are stored.

    Raises:
        BadInputError: The file cannot be read.
    """
    try:
        content = path.read_bytes()
    except OSError as error:
        raise BadInputError(f"{path}: cannot be read ({error})") from error
    return as_samples(decode_samples(path, content))


def write_png(path: Path, picture: NDArray[np.uint8]) -> None:
    """Writes a colour picture or a grey image, whole or not at all."""
    _, content = cv2.imencode(".png", picture)
    with atomic_path(path) as unfinished:
        unfinished.write_bytes(content.tobytes())


def distortion_map(camera: Camera) -> FloatMap | None:
    """Where to read each pixel of the undistorted image; None where the lens bends nothing."""
    if camera.is_pinhole:
        return None
    place = camera.undistortion_map()
    shift = np.abs(place - camera.pixel_grid()).max()
    return None if shift < INVISIBLE_PX else place
