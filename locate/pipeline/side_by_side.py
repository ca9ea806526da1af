"""The stage that measures, by several processes at the same time."""

from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path

from detect.detection import Detector
from geometry.processes import start_call
from locate.journal.progress import Report, silent
from locate.pipeline.detections import measure_frames
from locate.recording.posed_frames import PosedFrames

FEWEST_FRAMES = 4
"""A process of its own starts for so many frames at least; chosen by hand."""
MakeDetector = Callable[[], Detector]


def measure_side_by_side(
    posed: PosedFrames,
    make: MakeDetector,
    folder: Path,
    *,
    most: int,
    jobs: int,
    report: Report,
) -> str:
    """Does what `measure_frames` does, by at most `jobs` processes of which this is one.

    A camera at rest is left to one, as each would take out its shaking again.

    Args:
        posed: The frames.
        make: Makes the detector, in each process; sent by pickle.
        folder: Where to write.
        most: The most frames that are measured.
        jobs: The most processes.
        report: Takes the progress of this one's share.

    Raises:
        ChildProcessError: Another one was ended.
    """
    frames = min(most, len(posed.names))
    count = 1 if posed.trajectory is None else max(1, min(jobs, frames // FEWEST_FRAMES))
    detector = make()
    if count > 1:
        with ExitStack() as others:
            waits = [
                others.enter_context(
                    start_call(
                        measure_share,
                        posed,
                        make,
                        folder,
                        most,
                        (part, count),
                        name="measuring refraction",
                        report=silent,
                    )
                )
                for part in range(1, count)
            ]
            measure_frames(posed, detector, folder, most=most, report=report, share=(0, count))
            for wait in waits:
                wait()
        report = silent
    return measure_frames(posed, detector, folder, most=most, report=report)


def measure_share(
    posed: PosedFrames,
    make: MakeDetector,
    folder: Path,
    most: int,
    share: tuple[int, int],
    *,
    progress: Report,
) -> None:
    """Measures every n-th frame from the k-th on, for a share (k, n)."""
    measure_frames(posed, make(), folder, most=most, report=progress, share=share)
