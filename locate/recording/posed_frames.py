"""The frames of a run with their camera and its poses."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from detect.detection import Frames
from detect.fluctuation import longest_run
from detect.steady import SteadyImages
from geometry.arrays import FloatArray, IntArray
from geometry.camera import Camera
from geometry.stretch import Stretch
from geometry.trajectory import Trajectory
from locate.recording.images import FrameImages, FullSizeImages
from locate.recording.index import FULL_SIZE
from locate.recording.keyframes import CLOSELY_S
from locate.recording.motion import median_motion


@dataclass(frozen=True, kw_only=True)
class PosedFrames:
    """The frames of a run and what is known of their camera.

    Attributes:
        folder: Where the images are.
        names: N file names.
        indices: (N,) index of each in the recording.
        camera: That took them.
        trajectory: Its N poses; None where it was at rest.
        times_s: (N,) when each was taken; None where that is not known, as of photos.
        stretch: Of the recording, where the images are its own files of 16 bits.
        full_size: Width and height of the same frames in the folder `FULL_SIZE`, px; None where
            there are none.
        b_frames: Which indices are of B frames, on which a codec spends the fewest bits.
    """

    folder: Path
    names: Sequence[str]
    indices: IntArray
    camera: Camera
    trajectory: Trajectory | None = None
    times_s: FloatArray | None = None
    stretch: Stretch | None = None
    full_size: tuple[int, int] | None = None
    b_frames: Sequence[int] | IntArray = ()

    def undistorted(self) -> Frames:
        """The frames, undistorted, with the pinhole camera that would have taken them so.

        Those of a camera at rest are without its shaking.
        """
        if self.trajectory is None:
            return Frames(images=self.steady())
        return Frames(
            images=self._images(),
            trajectory=self.undistorted_trajectory(),
            full_size=self._full_size_images(),
            b_frames=self.rows_of(self.b_frames),
        )

    def steady(self) -> SteadyImages:
        """The frames of a camera at rest, undistorted and without its shaking."""
        return SteadyImages(self._images())

    def _images(self) -> FrameImages:
        paths = [self.folder / name for name in self.names]
        return FrameImages(paths, self.camera, self.stretch)

    def _full_size_images(self) -> FullSizeImages | None:
        if self.full_size is None:
            return None
        paths = [self.folder / FULL_SIZE / name for name in self.names]
        return FullSizeImages(paths, self.camera, self.full_size)

    def undistorted_trajectory(self) -> Trajectory | None:
        """The poses with the pinhole camera of the undistorted frames."""
        if self.trajectory is None:
            return None
        return replace(self.trajectory, camera=self.camera.undistorted())

    def longest_sequence(self) -> slice:
        """The rows of the longest run of frames that follow each other closely in time."""
        if self.times_s is None:
            return slice(0)
        return longest_run(self.times_s, CLOSELY_S)

    def image_motion_px(self) -> float:
        """How far the image moves from the first frame to the middle and the last, median, px."""
        paths = [self.folder / name for name in self.names]
        images = FrameImages(paths, stretch=self.stretch)
        ends = (len(images) // 2, len(images) - 1)
        return max(median_motion(images[0], images[end]) for end in ends)

    def rows_of(self, indices: Sequence[int] | IntArray) -> IntArray:
        """Which rows the frames of these indices are."""
        return np.searchsorted(self.indices, np.asarray(indices, dtype=np.int64))
