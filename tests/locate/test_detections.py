"""What a detector says of itself goes from the stage that looks to those that judge."""

import json
from pathlib import Path

import cv2
import numpy as np
import pytest

from detect.detection import Detection, Frames
from detect.response import Response
from geometry.camera import Camera
from geometry.errors import BadInputError
from geometry.reports import ignore_report
from locate.pipeline.detections import (
    load_detections,
    load_response,
    measure_frames,
)
from locate.recording.posed_frames import PosedFrames
from locate.recording.spacing import spread_key_rows

SAYS = Response(ratios=(0.0, 2.0), llr=(-1.0, 3.0))


class Blind:
    """Sees nothing, and says what it would see."""

    name = "blind"

    def __init__(self, response: Response | None) -> None:
        self.response = response

    def detect(self, frames: Frames, index: int) -> Detection:
        return Detection.without_evidence(frames.images[index].shape, depth=True)


@pytest.mark.parametrize("response", [SAYS, None])
def test_the_response_stands_beside_the_detections(
    tmp_path: Path, response: Response | None
) -> None:
    cv2.imwrite(str(tmp_path / "0.png"), np.zeros((12, 16), np.uint8))
    recorded = PosedFrames(
        folder=tmp_path,
        names=["0.png"],
        indices=np.array([7]),
        camera=Camera.pinhole(16, 12, 20.0),
    )
    measure_frames(recorded, Blind(response), tmp_path / "out", most=1, report=ignore_report)
    assert load_response(tmp_path / "out") == response
    assert load_detections(tmp_path / "out")[:2] == ("blind", [7])


def test_a_broken_response_is_refused(tmp_path: Path) -> None:
    content = {"detector": "blind", "indices": [], "response": {"ratios": [1]}}
    (tmp_path / "index.json").write_text(json.dumps(content))
    with pytest.raises(BadInputError, match=r"index\.json: not a response"):
        load_response(tmp_path)


@pytest.mark.parametrize(
    ("content", "says"),
    [
        (None, "cannot be read"),
        ("[", "not JSON"),
        ("[]", "not an index of detections"),
        ('{"indices": []}', "detector: Field required"),
    ],
)
def test_a_damaged_index_is_named(tmp_path: Path, content: str | None, says: str) -> None:
    if content is not None:
        (tmp_path / "index.json").write_text(content)
    with pytest.raises(BadInputError, match=rf"index\.json: .*{says}"):
        load_detections(tmp_path)


def test_frames_measured_already_are_left_out() -> None:
    first = spread_key_rows(60, 16, ends=3)
    others = spread_key_rows(60, 20, ends=3, skip=first)
    assert not set(first.tolist()) & set(others.tolist())
    assert (len(others), others.min() >= 3, others.max() <= 56) == (20, True, True)
    assert np.diff(others).max() <= 5
    assert spread_key_rows(20, 99, ends=3, skip=spread_key_rows(20, 14, ends=3)).size == 0


def test_b_frames_are_measured_where_no_other_is_near() -> None:
    b_frames = [row for row in range(60) if row % 4]
    rows = spread_key_rows(60, 16, ends=3, b_frames=b_frames)
    assert (len(rows), rows.min() >= 3, rows.max() <= 56) == (16, True, True)
    assert sum(row % 4 == 0 for row in rows) == 14  # of 14 between the ends
    assert np.diff(rows).max() <= 4
    assert spread_key_rows(60, 16, ends=3, b_frames=range(60)).tolist() == (
        spread_key_rows(60, 16, ends=3).tolist()
    )
