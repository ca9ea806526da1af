"""Poses that know which image they belong to, and the search for a recording's frames in them."""

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from geometry.angle_of_view import refuse_wide_lens
from geometry.arrays import FloatArray, IntArray
from geometry.camera import Camera
from geometry.errors import BadInputError
from geometry.pose_lists import LEAST_NS
from geometry.text_files import read_json
from geometry.trajectory import Trajectory

MAX_TIME_GAP_S = 0.02
"""Longest time between a frame and its pose."""
MAX_ASPECT_ERROR = 0.01
"""Largest relative difference of the aspects of a camera and an image; allows for whole px."""
_SECONDS = re.compile(r"[0-9]{9,10}\.[0-9]{3,9}")
"""Names that are s since 1970."""


@dataclass(frozen=True, kw_only=True)
class NamedPoses:
    """Poses as a file gives them.

    Attributes:
        trajectory: Its `indices` merely count the poses unless `has_indices`, its `times_s` too
            unless `has_times`.
        names: Image name of each pose; empty strings where the file has none.
        path: The file or folder, for messages.
        has_times: The file gives stamps.
        has_indices: The file gives frame indices.
    """

    trajectory: Trajectory
    names: tuple[str, ...]
    path: Path
    has_times: bool = False
    has_indices: bool = False

    def match_to_frames(
        self,
        sources: Sequence[str],
        indices: IntArray,
        times_s: FloatArray,
        *,
        size: tuple[int, int] | None = None,
    ) -> tuple[Trajectory, IntArray]:
        """The poses of a recording's frames.

        By name, by frame index or by time (to within 20 ms or half the spacing of the frames),
        whichever finds most frames, in this order where they find as many. Names that are numbers
        count as indices; where the lowest is 1, as ffmpeg writes them, 1 is the first frame.
        Photos named by their stamps since 1970, in ns or in s, have the times of their names.

        Args:
            sources: File name of each of the N frames.
            indices: (N,) their indices in the recording.
            times_s: (N,) their times.
            size: Width and height of the images in use; the camera is resized to it.

        Returns:
            The trajectory of the frames that have a pose, with the recording's indices and times,
            and (M,) the rows of those frames.

        Raises:
            BadInputError: Fewer than two frames have a pose, or the camera has another aspect, or
                sees more than 120 degrees.
        """
        stamps_s = _stamps_in_names(sources)
        by_time = self._by_time(times_s if stamps_s is None else stamps_s)
        ways = (self._by_name(sources), self._by_index(indices), by_time)
        pose_of = max(ways, key=len)
        if len(pose_of) < 2:
            raise BadInputError(
                f"{self.path}: {len(pose_of)} of {len(indices)} frames have a pose in it; "
                "image names, frame indices or time stamps must fit the recording"
            )
        rows = np.array(sorted(pose_of), dtype=np.int64)
        taken = self.trajectory.take([pose_of[int(row)] for row in rows])
        try:
            camera = taken.camera if size is None else resize_camera(taken.camera, *size)
            refuse_wide_lens(camera)
        except BadInputError as error:
            raise BadInputError(f"{self.path}: {error}") from error
        matched = replace(taken, camera=camera, indices=indices[rows], times_s=times_s[rows])
        return matched, rows

    def _by_name(self, sources: Sequence[str]) -> dict[int, int]:
        by_name = {Path(name).name: i for i, name in enumerate(self.names) if name}
        by_stem = {Path(name).stem: i for i, name in enumerate(self.names) if name}
        found = {
            row: by_name.get(Path(source).name, by_stem.get(Path(source).stem))
            for row, source in enumerate(sources)
        }
        matched = {row: pose for row, pose in found.items() if pose is not None}
        return matched if len(set(matched.values())) == len(matched) else {}

    def _by_index(self, indices: IntArray) -> dict[int, int]:
        known = self.trajectory.indices if self.has_indices else _frame_numbers(self.names)
        pose_of = {int(index): i for i, index in enumerate(known)}
        return {r: pose_of[int(i)] for r, i in enumerate(indices) if int(i) in pose_of}

    def _by_time(self, times_s: FloatArray) -> dict[int, int]:
        if not self.has_times or len(self.trajectory) == 0:
            return {}
        known = self.trajectory.times_s
        spacing_s = float(np.median(np.diff(times_s))) if len(times_s) > 1 else np.inf
        nearest = np.abs(known[None, :] - times_s[:, None]).argmin(axis=1)
        close = np.abs(known[nearest] - times_s) <= min(MAX_TIME_GAP_S, spacing_s / 2)
        return {int(row): int(nearest[row]) for row in np.flatnonzero(close)}


def resize_camera(camera: Camera, width: int, height: int) -> Camera:
    """The camera for images resized to `width` x `height`.

    Raises:
        BadInputError: The aspect is another.
    """
    if (camera.width, camera.height) == (width, height):
        return camera
    if abs(width / camera.width * camera.height / height - 1) > MAX_ASPECT_ERROR:
        raise BadInputError(
            f"the camera is for {camera.width}x{camera.height} images, these are {width}x{height}"
        )
    model = camera.to_colmap()
    model.rescale(width, height)
    return Camera.from_colmap(model)


def read_camera(path: Path, width: int, height: int) -> Camera:
    """The camera of a JSON file, or of its `camera` block, for images of that size.

    Raises:
        BadInputError: The file cannot be read, is none, the aspect is another, or the lens sees
            more than 120 degrees.
    """
    content = read_json(path)
    try:
        camera = resize_camera(Camera.from_dict(content.get("camera", content)), width, height)
        refuse_wide_lens(camera)
    except (ValueError, AttributeError, BadInputError) as error:
        raise BadInputError(f"{path}: not a camera file ({error})") from error
    return camera


def _stamps_in_names(sources: Sequence[str]) -> FloatArray | None:
    """(N,) s since 1970 where all frames are named by them, in whole ns or s with a fraction."""
    stems = [Path(source).stem for source in sources]
    if stems and all(stem.isdecimal() and int(stem) >= LEAST_NS for stem in stems):
        return np.array([int(stem) / 1e9 for stem in stems])
    if stems and all(_SECONDS.fullmatch(stem) for stem in stems):
        return np.array([float(stem) for stem in stems])
    return None


def _frame_numbers(names: Sequence[str]) -> list[int]:
    """The names as frame indices; empty where one is no number."""
    stems = [Path(name).stem for name in names]
    if not stems or not all(stem.isdecimal() for stem in stems):
        return []
    numbers = [int(stem) for stem in stems]
    first = 1 if min(numbers) == 1 else 0
    return [number - first for number in numbers]
