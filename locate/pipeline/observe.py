"""The stage that looks: refraction measured in some of the frames."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Self

import numpy as np
from pydantic import BaseModel, ValidationError

from detect.detection import Detection, Detector, Frames
from detect.fluctuation import in_a_row
from detect.response import Response
from geometry.arrays import FloatArray, GreyImage, IntArray
from geometry.atomic import replacing
from geometry.camera import Camera
from geometry.errors import BadInputError, first_complaint
from geometry.npz import read_npz, save_arrays
from geometry.trajectory import Trajectory
from locate.journal.progress import Report
from locate.recording.images import FrameImages
from locate.recording.keyframes import CLOSELY_S
from locate.recording.motion import median_motion

ENDS = 3
WHOLE = (0, 1)
INDEX = "index.json"


@dataclass(frozen=True, kw_only=True)
class Recorded:
    """The frames of a run and what is known of their camera.

    Attributes:
        folder: Where the images are.
        names: N file names.
        indices: (N,) index of each in the recording.
        camera: That took them.
        trajectory: Its N poses; None where it stood still.
        times_s: (N,) when each was taken; None where that is not known, as of photos.
    """

    folder: Path
    names: Sequence[str]
    indices: IntArray
    camera: Camera
    trajectory: Trajectory | None = None
    times_s: FloatArray | None = None

    def frames(self) -> Frames:
        """The frames, undistorted, with the pinhole camera that would have taken them so."""
        images = FrameImages([self.folder / name for name in self.names], self.camera)
        return Frames(images=images, trajectory=self.undistorted_trajectory())

    def undistorted_trajectory(self) -> Trajectory | None:
        """The poses with the pinhole camera of the undistorted frames."""
        if self.trajectory is None:
            return None
        return replace(self.trajectory, camera=self.camera.undistorted())

    def in_a_row(self) -> Sequence[GreyImage]:
        """The frames, undistorted, of the longest run that follow each other closely."""
        if self.times_s is None:
            return ()
        return self.frames().images[in_a_row(self.times_s, CLOSELY_S)]

    def drift_px(self) -> float:
        """How far the image moves from the first frame to the middle and the last, median, px."""
        images = FrameImages([self.folder / name for name in self.names])
        ends = (len(images) // 2, len(images) - 1)
        return max(median_motion(images[0], images[end]) for end in ends)

    def rows(self, indices: Sequence[int]) -> IntArray:
        """Which rows the frames of these indices are."""
        return np.searchsorted(self.indices, np.asarray(indices, dtype=np.int64))


def observe(
    recorded: Recorded,
    detector: Detector,
    folder: Path,
    *,
    most: int,
    report: Report,
    share: tuple[int, int] = WHOLE,
) -> str:
    """Runs a detector over at most `most` frames, one file a frame, and writes index.json.

    Frames that already have their file are left alone. Of a share (k, n), every n-th frame from
    the k-th is done, and no index written.
    """
    folder.mkdir(exist_ok=True)
    frames = recorded.frames()
    rows = spread(len(frames), most, ends=0 if recorded.trajectory is None else ENDS)
    mine = rows[share[0] :: share[1]]
    for done, row in enumerate(mine):
        report("detections", done / len(mine))
        path = folder / f"{recorded.indices[row]:06d}.npz"
        if not path.exists():
            detector.detect(frames, int(row)).save(path)
    report("detections", 1.0)
    if share == WHOLE:
        _Index(
            detector=detector.name,
            indices=recorded.indices[rows].tolist(),
            response=None if detector.response is None else detector.response.to_plain(),
        ).save(folder)
    return f"{len(rows)} frames, {detector.name}"


def load_points(path: Path) -> FloatArray | None:
    """(M, 3) sparse points of a reconstruction, or None where there is none."""
    if not path.exists():
        return None
    return np.asarray(read_npz(path)["points_in_world"], dtype=float)


def save_points(path: Path, points_in_world: FloatArray) -> None:
    """Writes what `load_points` reads."""
    save_arrays(path, points_in_world=points_in_world)


def load_detections(folder: Path) -> tuple[str, list[int], list[Detection]]:
    """The detector's name, the frame indices and the detections that `observe` wrote.

    Raises:
        BadInputError: A file is missing or broken; named.
    """
    index = _Index.load(folder)
    found = [Detection.load(folder / f"{i:06d}.npz") for i in index.indices]
    return index.detector, index.indices, found


def load_response(folder: Path) -> Response | None:
    """What evidence the detector of `load_detections` gives a displacement, where it said so.

    Raises:
        BadInputError: It said something else.
    """
    said = _Index.load(folder).response
    return None if said is None else Response.from_plain(said, str(folder / INDEX))


def spread(count: int, most: int, *, ends: int) -> IntArray:
    """At most `most` of `count` rows, evenly, without the `ends` that lack neighbours."""
    ends = min(ends, (count - 1) // 2)
    usable = count - 2 * ends
    chosen = np.linspace(ends, count - 1 - ends, min(most, usable))
    return np.rint(chosen).astype(np.int64)


class _Index(BaseModel):
    """What lies in a folder of detections, as it stands in index.json."""

    detector: str
    indices: list[int]
    response: dict[str, Any] | None = None

    def save(self, folder: Path) -> None:
        with replacing(folder / INDEX) as path:
            path.write_text(self.model_dump_json(exclude_none=True))

    @classmethod
    def load(cls, folder: Path) -> Self:
        path = folder / INDEX
        try:
            return cls.model_validate_json(path.read_bytes())
        except OSError as error:
            raise BadInputError(f"{path}: cannot be read ({error.strerror})") from error
        except ValidationError as error:
            what = " ".join(first_complaint(error)).strip()
            raise BadInputError(f"{path}: not an index of detections ({what})") from error
