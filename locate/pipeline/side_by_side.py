"""The stage that measures, by several processes at the same time."""

from collections.abc import Callable, Sequence
from contextlib import ExitStack
from functools import partial
from pathlib import Path

from detect.detection import Detector
from geometry.processes import ProcessesAhead
from geometry.reports import Report, ignore_report
from locate.pipeline.detections import measure_frames
from locate.recording.posed_frames import PosedFrames

FEWEST_FRAMES = 5
"""A process of its own starts for so many frames at least: it costs as much as two frames."""
MOST_BYTES = 3_000_000_000
"""Memory that all processes together may hold where frames are measured at full size; chosen."""
OWN_BYTES, BYTES_PER_PIXEL = 600_000_000, 110
"""What one holds, and what it holds more for each pixel at full size (docs/weak_plumes.md)."""
NAME = "measuring refraction"
MakeDetector = Callable[[], Detector]


def expect_shares(ahead: ProcessesAhead, *, most: int, jobs: int) -> None:
    """Starts the processes that `measure_side_by_side` takes, while earlier stages run.

    Args:
        ahead: Where they wait.
        most: The most frames that are measured.
        jobs: The most processes, of which this is one.
    """
    for _ in range(1, min(jobs, most // FEWEST_FRAMES)):
        ahead.expect(measure_share, name=NAME)


def measure_side_by_side(
    posed: PosedFrames,
    make: MakeDetector,
    folder: Path,
    *,
    most: int,
    skip: Sequence[int] = (),
    jobs: int,
    ahead: ProcessesAhead | None = None,
    report: Report,
) -> str:
    """Does what `measure_frames` does, by at most `jobs` processes of which this is one.

    A camera at rest is left to one, as each would take out its shaking again. At full size there
    are so many that they hold `MOST_BYTES` together.

    Args:
        posed: The frames.
        make: Makes the detector, in each process; sent by pickle.
        folder: Where to write.
        most: The most frames that are measured.
        skip: Indices of frames that are not.
        jobs: The most processes.
        ahead: Processes that `expect_shares` started.
        report: Takes the progress of this one's share.

    Raises:
        ChildProcessError: Another one was ended.
    """
    frames = min(most, len(posed.names) - len(skip))
    count = max(1, min(jobs, frames // FEWEST_FRAMES, affordable_jobs(posed.full_size, jobs)))
    count = 1 if posed.trajectory is None else count
    measure = partial(measure_frames, posed, make(), folder, most=most, skip=skip)
    if count > 1:
        ahead = ahead or ProcessesAhead()
        with ExitStack() as others:
            waits = []
            for part in range(1, count):
                process = others.enter_context(ahead.take(measure_share, name=NAME))
                given = posed, make, folder, most, skip, (part, count)
                waits.append(process.call(*given, report=ignore_report))
            measure(report=report, share=(0, count))
            for wait in waits:
                wait()
        report = ignore_report
    return measure(report=report)


def affordable_jobs(full_size: tuple[int, int] | None, jobs: int) -> int:
    """So many processes, or fewer for frames of that width and height at full size, px."""
    if full_size is None:
        return jobs
    each = OWN_BYTES + BYTES_PER_PIXEL * full_size[0] * full_size[1]
    return max(1, min(jobs, MOST_BYTES // each))


def measure_share(
    posed: PosedFrames,
    make: MakeDetector,
    folder: Path,
    most: int,
    skip: Sequence[int],
    share: tuple[int, int],
    *,
    progress: Report,
) -> None:
    """Measures every n-th frame from the k-th on, for a share (k, n)."""
    measure_frames(posed, make(), folder, most=most, skip=skip, report=progress, share=share)
