"""The stage that measures: refraction in some of the frames, one file a frame."""

from pathlib import Path
from typing import Any, Self

import numpy as np
from pydantic import BaseModel, ValidationError

from detect.detection import Detection, Detector
from detect.response import Response
from geometry.arrays import IntArray
from geometry.atomic import atomic_path
from geometry.errors import BadInputError, first_complaint
from geometry.json_text import parse_json
from locate.journal.progress import Report
from locate.recording.posed_frames import PosedFrames

ENDS = 3
"""Frames at each end of a recording that are not measured: they lack neighbours on one side."""
WHOLE = (0, 1)
"""The share of a stage that is all of it: every frame from the first."""
INDEX = "index.json"


def measure_frames(
    posed: PosedFrames,
    detector: Detector,
    folder: Path,
    *,
    most: int,
    most_displacement_only: int = 0,
    report: Report,
    share: tuple[int, int] = WHOLE,
) -> str:
    """Runs a detector over at most `most` frames, one file a frame, and writes index.json.

    Of at most `most_displacement_only` others the displacement alone is measured, if the detector
    can. Frames that already have their file are left alone, unless it is damaged. Of a share
    (k, n), every n-th frame from the k-th is done, and no index written.
    """
    folder.mkdir(exist_ok=True)
    frames = posed.undistorted()
    ends = 0 if posed.trajectory is None else ENDS
    rows = spread_rows(len(frames), most, ends=ends)
    work = [(detector, row) for row in rows.tolist()]
    others = np.empty(0, np.int64)
    if most_displacement_only and detector.displacement_only is not None:
        rest = np.setdiff1d(np.arange(ends, len(frames) - ends), rows)
        others = rest[spread_rows(len(rest), most_displacement_only, ends=0)]
        work += [(detector.displacement_only, row) for row in others.tolist()]
    share_work = work[share[0] :: share[1]]
    for done, (measuring, row) in enumerate(share_work):
        report("detections", done / len(share_work))
        path = folder / f"{posed.indices[row]:06d}.npz"
        if not is_whole(path):
            measuring.detect(frames, row).save(path)
    report("detections", 1.0)
    if share == WHOLE:
        DetectionIndex(
            detector=detector.name,
            indices=posed.indices[rows].tolist(),
            displacement_only=posed.indices[others].tolist(),
            response=None if detector.response is None else detector.response.to_plain(),
        ).save(folder)
    more = f", the displacement alone of {len(others)}" if len(others) else ""
    return f"{len(rows)} frames, {detector.name}{more}"


def is_whole(path: Path) -> bool:
    """Whether a detection is there and can be read."""
    if not path.exists():
        return False
    try:
        Detection.load(path)
    except BadInputError:
        return False
    return True


def load_detections(folder: Path) -> tuple[str, list[int], list[Detection]]:
    """The detector's name, the frame indices and the detections that `measure_frames` wrote.

    Raises:
        BadInputError: A file is missing or broken; named.
    """
    index = DetectionIndex.load(folder)
    found = [Detection.load(folder / f"{i:06d}.npz") for i in index.indices]
    return index.detector, index.indices, found


def load_displacement_only(folder: Path) -> tuple[list[int], list[Detection]]:
    """Frame indices and detections of the frames of which the displacement alone was measured.

    Raises:
        BadInputError: A file is missing or broken; named.
    """
    indices = DetectionIndex.load(folder).displacement_only
    return indices, [Detection.load(folder / f"{i:06d}.npz") for i in indices]


def load_response(folder: Path) -> Response | None:
    """What evidence the detector of `load_detections` gives a displacement; None if not stated.

    Raises:
        BadInputError: What is stated cannot be read.
    """
    stated = DetectionIndex.load(folder).response
    return None if stated is None else Response.from_plain(stated, str(folder / INDEX))


def spread_rows(count: int, most: int, *, ends: int) -> IntArray:
    """At most `most` of `count` rows, evenly, without the `ends` that lack neighbours."""
    ends = min(ends, (count - 1) // 2)
    usable = count - 2 * ends
    chosen = np.linspace(ends, count - 1 - ends, min(most, usable))
    return np.rint(chosen).astype(np.int64)


class DetectionIndex(BaseModel):
    """What a folder of detections holds: its index.json.

    Attributes:
        detector: Its name.
        indices: Of the frames that it measured.
        displacement_only: Of others, of which the displacement alone was measured.
        response: As of a `Detector`.
    """

    detector: str
    indices: list[int]
    displacement_only: list[int] = []
    response: dict[str, Any] | None = None

    def save(self, folder: Path) -> None:
        """Writes the index, whole or not at all."""
        with atomic_path(folder / INDEX) as path:
            path.write_text(self.model_dump_json(exclude_none=True))

    @classmethod
    def load(cls, folder: Path) -> Self:
        """Reads what `save` wrote.

        Raises:
            BadInputError: It is missing or broken.
        """
        path = folder / INDEX
        try:
            return cls.model_validate(parse_json(path.read_text()))
        except OSError as error:
            raise BadInputError(f"{path}: cannot be read ({error.strerror})") from error
        except ValidationError as error:
            what = " ".join(first_complaint(error)).strip()
            raise BadInputError(f"{path}: not an index of detections ({what})") from error
        except ValueError as error:
            raise BadInputError(f"{path}: not an index of detections ({error})") from error
