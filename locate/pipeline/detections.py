"""The stage that measures: refraction in some of the frames, one file a frame."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any, Self

from pydantic import BaseModel

from detect.detection import Detection, Detector
from detect.response import Response
from geometry.atomic import write_text_atomic
from geometry.errors import BadInputError
from geometry.json_values import check_fields
from geometry.reports import Report
from geometry.text_files import read_json
from locate.recording.posed_frames import PosedFrames
from locate.recording.spacing import spread_key_rows

ENDS = 3
"""Frames at each end of a recording that are not measured: they lack neighbours on one side."""
WHOLE = (0, 1)
"""The share (k, n) that is all of a stage."""
INDEX = "index.json"


def measure_frames(
    posed: PosedFrames,
    detector: Detector,
    folder: Path,
    *,
    most: int,
    skip: Sequence[int] = (),
    report: Report,
    share: tuple[int, int] = WHOLE,
) -> str:
    """Runs a detector over some of the frames, and writes a file for each and index.json.

    Frames that have their file already are not measured again, unless it is damaged.

    Args:
        posed: The frames.
        detector: Measures them.
        folder: Where to write; made where it is missing.
        most: The most frames that are measured, spread evenly.
        skip: Indices of frames that are left out.
        report: Takes the progress.
        share: (k, n): of the frames chosen, only every n-th from the k-th is measured, and no
            index is written.

    Returns:
        A summary.
    """
    folder.mkdir(exist_ok=True)
    frames = posed.undistorted()
    rows = spread_key_rows(
        len(frames),
        most,
        ends=0 if posed.trajectory is None else ENDS,
        skip=posed.rows_of(skip),
        b_frames=frames.b_frames,
    )
    share_rows = rows[share[0] :: share[1]]
    for done, row in enumerate(share_rows):
        report("detections", done / len(share_rows))
        path = folder / f"{posed.indices[row]:06d}.npz"
        if not is_whole(path):
            detector.detect(frames, int(row)).save(path)
    report("detections", 1.0)
    if share == WHOLE:
        DetectionIndex(
            detector=detector.name,
            indices=posed.indices[rows].tolist(),
            response=None if detector.response is None else detector.response.to_plain(),
        ).save(folder)
    return f"{len(rows)} frames, {detector.name}"


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


def load_response(folder: Path) -> Response | None:
    """What evidence the detector of `load_detections` gives a displacement; None if not stated.

    Raises:
        BadInputError: What is stated cannot be read.
    """
    stated = DetectionIndex.load(folder).response
    return None if stated is None else Response.from_plain(stated, str(folder / INDEX))


class DetectionIndex(BaseModel):
    """What a folder of detections holds: its index.json."""

    detector: str
    indices: list[int]
    response: dict[str, Any] | None = None

    def save(self, folder: Path) -> None:
        """Writes the index, whole or not at all."""
        write_text_atomic(folder / INDEX, self.model_dump_json(exclude_none=True))

    @classmethod
    def load(cls, folder: Path) -> Self:
        """Reads what `save` wrote.

        Raises:
            BadInputError: It is missing or broken.
        """
        path = folder / INDEX
        try:
            return check_fields(cls, read_json(path))
        except ValueError as error:
            raise BadInputError(f"{path}: not an index of detections ({error})") from error
