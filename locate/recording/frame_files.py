"""The frames of any recording as files, so that each can be read when it is wanted."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Self

import numpy as np

from detect.detection import Frames
from geometry.errors import BadInputError
from geometry.named_poses import NamedPoses
from geometry.printable import printable
from geometry.sfm.given_poses import check_given_poses
from geometry.stretch import Stretch
from locate.recording.images import FrameImages, write_png
from locate.recording.posed_frames import PosedFrames
from locate.recording.recording import Recording

PHOTOS_FPS = 4.0
"""Frames per second of a video made from photos, slow enough to look at each."""


@dataclass(frozen=True, kw_only=True)
class FrameFiles:
    """Frames in files of one folder.

    Attributes:
        folder: That folder.
        names: Their N file names.
        indices: Of each in the recording.
        times_s: Of each; of photos the index.
        size: Width and height of the first, px.
        is_video: They are of a video, else photos.
        stretch: Of the recording, for photos of 16 bits.
    """

    folder: Path
    names: tuple[str, ...]
    indices: tuple[int, ...]
    times_s: tuple[float, ...]
    size: tuple[int, int]
    is_video: bool
    stretch: Stretch | None = None

    @classmethod
    def of(cls, recording: Recording, workshop: Path, *, every: int = 1) -> Self:
        """Every so many of the photos themselves, or of a video's frames, written to `workshop`.

        Raises:
            BadInputError: The frames of a video change in size.
        """
        size = (recording.width, recording.height)
        if not recording.is_video:
            photos = recording.photos[::every]
            indices = tuple(range(0, len(recording.photos), every))
            return cls(
                folder=photos[0].parent,
                names=tuple(photo.name for photo in photos),
                indices=indices,
                times_s=tuple(map(float, indices)),
                size=size,
                is_video=False,
                stretch=recording.stretch,
            )
        kept = []
        for frame in recording.frames(lambda index, _: index % every == 0):
            write_png(workshop / f"{frame.index:06d}.png", frame.image)
            kept.append((frame.index, frame.time_s))
        indices, times_s = zip(*kept, strict=True)
        return cls(
            folder=workshop,
            names=tuple(f"{index:06d}.png" for index in indices),
            indices=indices,
            times_s=times_s,
            size=size,
            is_video=True,
        )

    @property
    def fps(self) -> float:
        """Frames per second; `PHOTOS_FPS` where they are photos, which have no times."""
        length_s = self.times_s[-1] - self.times_s[0]
        return (len(self.names) - 1) / length_s if self.is_video and length_s > 0 else PHOTOS_FPS

    @property
    def labels(self) -> tuple[str, ...]:
        """What results are called: the names without their suffix, each once in a folder."""
        return tuple(Path(name).stem for name in self.names)

    def frames(self) -> Frames:
        """The frames as they are."""
        paths = [self.folder / name for name in self.names]
        return Frames(images=FrameImages(paths, stretch=self.stretch))

    def with_poses(self, poses: NamedPoses) -> tuple[Self, Frames, tuple[str, ...]]:
        """Those that have a pose, these undistorted, and what a reader should know of the poses.

        Args:
            poses: Of frames of this recording.

        Raises:
            BadInputError: Fewer than two frames have a pose, a frame has another size than the
                first, or the images contradict the poses.
        """
        trajectory, rows = poses.match_to_frames(
            self.names, np.array(self.indices), np.array(self.times_s), size=self.size
        )
        left = self.select_rows(rows.tolist())
        images = FrameImages([left.folder / name for name in left.names], stretch=left.stretch)
        for name, image in zip(left.names, images, strict=True):
            if image.shape[::-1] != self.size:
                raise BadInputError(
                    f"{left.folder / name}: {image.shape[1]}x{image.shape[0]} px, where the poses' "
                    f"camera is for {self.size[0]}x{self.size[1]}; give frames of one size"
                )
        try:
            notes = check_given_poses(trajectory, images)
        except BadInputError as error:
            raise BadInputError(f"{poses.path}: {error}") from error
        if len(rows) < len(self.names):
            lost = len(self.names) - len(rows)
            where = poses.path.name
            notes = (
                f"{lost} of {len(self.names)} frames have no pose in {where} and are left out",
                *notes,
            )
        posed = PosedFrames(
            folder=left.folder,
            names=left.names,
            indices=trajectory.indices,
            camera=trajectory.camera,
            trajectory=trajectory,
            stretch=self.stretch,
        )
        return left, posed.undistorted(), tuple(map(printable, notes))

    def select_rows(self, rows: Sequence[int]) -> Self:
        """Those of these rows."""
        return type(self)(
            folder=self.folder,
            names=tuple(self.names[row] for row in rows),
            indices=tuple(self.indices[row] for row in rows),
            times_s=tuple(self.times_s[row] for row in rows),
            size=self.size,
            is_video=self.is_video,
            stretch=self.stretch,
        )
