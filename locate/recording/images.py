"""The frames of a run, read and undistorted on demand."""

from collections import OrderedDict
from collections.abc import Sequence
from pathlib import Path
from typing import overload

import cv2
import numpy as np
from numpy.typing import NDArray

from detect.warp import pixel_grid, sample
from geometry.arrays import FloatMap, GreyImage, GreySamples
from geometry.atomic import atomic_path
from geometry.camera import Camera
from geometry.errors import BadInputError
from geometry.regular_files import read_content
from geometry.stretch import FINE, Samples, Stretch, as_samples, deep_samples, in_8_bits
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
        _refuse_lost(path)
        image = read_grey(path, self._stretch)
        if self._map is not None:
            image = np.rint(sample(image, self._map)).clip(0, 255).astype(np.uint8)
        return image


class FullSizeImages(Sequence[FloatMap]):
    """Frames in files at full size, as grey levels with fractions, seen by a pinhole camera.

    None stays in memory.

    Args:
        paths: The files, of 8 bits, or of 16 with `FINE` steps per grey level.
        camera: That took them, in px of frames that may be smaller.
        size: Width and height of the files, px.
    """

    def __init__(self, paths: Sequence[Path], camera: Camera, size: tuple[int, int]) -> None:
        self._paths = list(paths)
        self._map = _enlarge_positions(distortion_map(camera), size)

    def __len__(self) -> int:
        return len(self._paths)

    @overload
    def __getitem__(self, i: int) -> FloatMap: ...
    @overload
    def __getitem__(self, i: slice) -> list[FloatMap]: ...
    def __getitem__(self, i: int | slice) -> FloatMap | list[FloatMap]:
        if isinstance(i, slice):
            return [self[row] for row in range(len(self))[i]]
        path = self._paths[i]
        _refuse_lost(path)
        samples = read_samples(path)
        image = samples.astype(np.float32)
        if samples.dtype == np.uint16:
            image /= FINE
        return image if self._map is None else sample(image, self._map)


def _refuse_lost(path: Path) -> None:
    if not path.exists():
        raise BadInputError(f"{path}: is gone; in a run folder, repeat the run with --force")


def _enlarge_positions(positions: FloatMap | None, size: tuple[int, int]) -> FloatMap | None:
    """Positions (h, w, 2) in a small frame as those (H, W, 2) in a large one of that size, px."""
    if positions is None:
        return None
    height, width = positions.shape[:2]
    shift = cv2.resize(positions - pixel_grid((height, width)), size)
    factors = np.array([size[0] / width, size[1] / height], np.float32)
    return np.asarray(shift * factors + pixel_grid(size[::-1]))


def read_grey(path: Path, stretch: Stretch | None = None) -> GreyImage:
    """An image file in grey: colour is weighted, alpha ignored, EXIF's turn of it obeyed.

    Args:
        path: The file.
        stretch: Of the recording, for deep samples; without one it is chosen from the file.

    Raises:
        BadInputError: See `read_samples`.
    """
    return in_8_bits(show_in_grey(read_samples(path), stretch))


def show_in_grey(samples: Samples, stretch: Stretch | None = None) -> GreySamples:
    """The (H, W) image that `read_grey` gives of these samples, before it is rounded to 8 bits."""
    deep = deep_samples(samples)
    if deep is None:
        return np.asarray(samples, dtype=np.uint8)
    scale = stretch or Stretch.choose([deep])
    return np.zeros(deep.shape, np.uint8) if scale is None else scale.apply_finely(deep)


def read_samples(path: Path) -> Samples:
    """The (H, W) samples of an image file in grey, as deep as they are stored.

    Raises:
        BadInputError: The file cannot be read.
    """
    try:
        content = read_content(path)
    except OSError as error:
        raise BadInputError(f"{path}: cannot be read ({error})") from error
    return as_samples(decode_samples(path, content))


def write_png(path: Path, picture: NDArray[np.uint8] | NDArray[np.uint16]) -> None:
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
