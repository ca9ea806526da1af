"""What structure from motion works on, and how far it is."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import pycolmap

from geometry.arrays import FloatArray, IntArray
from geometry.reports import Report
from geometry.sfm.features import MatchedPair

STAGES = {  # start and share of the whole call
    "finding features": (0.0, 0.25),
    "matching features": (0.25, 0.2),
    "mapping": (0.45, 0.45),
    "adjusting": (0.9, 0.1),
}


class ProgressMeter:
    """Turns the fraction of a stage into that of the whole call, which never falls."""

    def __init__(self, report: Report | None) -> None:
        self._report = report
        self._reached = 0.0

    def __call__(self, stage: str, fraction: float) -> None:
        """Reports the fraction of a stage that is done."""
        start, share = STAGES[stage]
        self._reached = max(self._reached, start + share * fraction)
        if self._report:
            self._report(stage, self._reached)


@dataclass(frozen=True, kw_only=True)
class MappingJob:
    """What there is to map.

    Attributes:
        image_dir: Folder of the images.
        names: N file names in it.
        indices: (N,) index of each in its recording.
        times_s: (N,) time of each.
        workdir: Where the database and the models go.
        start: The camera to start from, of all images.
        refine: Its intrinsics are estimated too.
        focal_prior_px: Focal length from metadata.
        ordered: Frames of a video.
        progress: Takes a stage and the share of it that is done.
        jobs: Threads that work side by side; the result does not depend on it.
        pairs: Verified pairs, once they are known.
    """

    image_dir: Path
    names: list[str]
    indices: IntArray
    times_s: FloatArray
    workdir: Path
    start: pycolmap.Camera
    refine: bool
    focal_prior_px: float | None
    ordered: bool
    progress: Report
    jobs: int = 1
    pairs: Sequence[MatchedPair] = ()

    @property
    def database(self) -> Path:
        """COLMAP's database of features and matches."""
        return self.workdir / "database.db"
