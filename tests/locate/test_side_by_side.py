"""Refraction measured by several processes at the same time."""

import os
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from detect.detection import Detection, Frames
from geometry.errors import BadInputError
from locate.pipeline.detections import load_detections
from locate.pipeline.side_by_side import FEWEST_FRAMES, affordable_jobs, measure_side_by_side
from locate.recording.images import write_png
from locate.recording.posed_frames import PosedFrames
from locate.simulation.evidence import orbit_trajectory

SHAPE = (240, 320)
FRAMES = 3 * FEWEST_FRAMES + 2


class MarkingDetector:
    """Says which frame it was asked for, and by which process."""

    name = "marking"
    response = None
    uses_other_frames = True

    def __init__(self, broken: int | None = None) -> None:
        self.broken = broken

    def detect(self, frames: Frames, index: int) -> Detection:
        if index == self.broken:
            raise BadInputError(f"frame {index}: broken")
        empty = Detection.without_evidence(SHAPE, depth=False)
        mark = np.full((*SHAPE, 2), [index, os.getpid() % 2000], np.float32)
        return Detection(displacement=mark, sigma_px=empty.sigma_px, llr=empty.llr)


@pytest.fixture
def posed(tmp_path: Path) -> PosedFrames:
    trajectory = orbit_trajectory(FRAMES, 60)
    names = [f"{index}.png" for index in trajectory.indices]
    (tmp_path / "frames").mkdir()
    for name in names:
        write_png(tmp_path / "frames" / name, np.zeros(SHAPE, np.uint8))
    return PosedFrames(
        folder=tmp_path / "frames",
        names=names,
        indices=trajectory.indices,
        camera=trajectory.camera,
        trajectory=trajectory,
    )


def measure(
    posed: PosedFrames, folder: Path, jobs: int, broken: int | None = None
) -> tuple[list[int], list[float], int]:
    """The frames of the index, what was measured of each, and by how many processes."""
    shares: list[float] = []
    measure_side_by_side(
        posed,
        partial(MarkingDetector, broken),
        folder,
        most=FRAMES,
        jobs=jobs,
        report=lambda _, share: shares.append(share),
    )
    assert shares == sorted(shares)
    assert shares[-1] == 1.0
    _, indices, found = load_detections(folder)
    marks = [detection.displacement[0, 0] for detection in found]
    return indices, [float(mark[0]) for mark in marks], len({float(mark[1]) for mark in marks})


def test_processes_share_the_frames_and_nothing_else_changes(
    posed: PosedFrames, tmp_path: Path
) -> None:
    alone = measure(posed, tmp_path / "alone", 1)
    together = measure(posed, tmp_path / "together", 8)
    assert together[:2] == alone[:2]
    assert together[0] == [int(mark) for mark in together[1]]
    assert (alone[2], together[2]) == (1, 3)


def test_what_one_process_cannot_do_is_raised(posed: PosedFrames, tmp_path: Path) -> None:
    with pytest.raises(BadInputError, match="frame 4: broken"):
        measure(posed, tmp_path / "out", 2, broken=4)
    assert not (tmp_path / "out" / "index.json").exists()


@pytest.mark.parametrize(
    ("full_size", "jobs", "affordable"),
    [(None, 16, 16), ((1920, 1080), 16, 3), ((1920, 1080), 2, 2), ((3840, 2160), 16, 1)],
)
def test_frames_at_full_size_are_measured_by_as_many_as_memory_holds(
    full_size: tuple[int, int] | None, jobs: int, affordable: int
) -> None:
    assert affordable_jobs(full_size, jobs) == affordable
