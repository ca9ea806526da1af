"""More frames, of which the displacement alone is measured, for plumes too weak for 16."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from detect.detection import Detection
from geometry.removal import remove_inside
from locate.pipeline.detections import load_detections
from locate.pipeline.side_by_side import MakeDetector, measure_side_by_side
from locate.recording.posed_frames import PosedFrames

FOLDER = "displacements"


@dataclass(frozen=True, kw_only=True)
class MoreFrames:
    """How more frames are measured.

    Attributes:
        make: Makes the detector that measures the displacement alone.
        most: Of them.
        always: Whether they are measured though the answer without them is sure.
        jobs: The most processes.
    """

    make: MakeDetector
    most: int
    always: bool
    jobs: int

    def measure(
        self,
        posed: PosedFrames,
        skip: Sequence[int],
        parent: Path,
        progress: Callable[[float], None],
    ) -> tuple[list[int], list[Detection]]:
        """The indices of the frames, and their detections; none where no frame is left.

        Args:
            posed: The frames.
            skip: Indices of those that are measured already. B frames are left out too: a codec
                spoils them alike from view to view.
            parent: Holds a file a frame meanwhile; an interrupted run goes on from what is there.
            progress: Receives the share done, from 0 to 1.
        """
        measure_side_by_side(
            posed,
            self.make,
            parent / FOLDER,
            most=self.most,
            skip=sorted({*skip, *posed.b_frames}),
            jobs=self.jobs,
            report=lambda _stage, share: progress(share),
        )
        _, indices, found = load_detections(parent / FOLDER)
        remove_inside(parent, FOLDER)
        return indices, found
