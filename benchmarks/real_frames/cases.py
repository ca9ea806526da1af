"""Recordings, and the folders of their cases."""

import argparse
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from locate.recording.formats import PHOTO_SUFFIXES

RECORDINGS = Path("../shared/data/2_dense_video")
STRENGTHS_PX = (0.0, 0.1, 0.3, 1.0)
PLACES = range(6)
FEWEST = 12
"""Frames of a recording: less leave no neighbours to most of them."""


@dataclass(frozen=True, kw_only=True)
class Case:
    """One plume of one strength before one recording; without one, the recording as it is.

    Attributes:
        recording: The folder of its frames.
        folder: What belongs to the case.
        film: What `locate simulate --onto` wrote: frames/, truth/ and truth.json.
        strength_px: 95th percentile of |w|.
        place: Number of the place; None without a plume.
    """

    recording: Path
    folder: Path
    film: Path
    strength_px: float
    place: int | None

    @property
    def frames(self) -> Path:
        """The folder that `locate run` is given."""
        return self.recording if self.place is None else self.film / "frames"

    @property
    def filmed(self) -> bool:
        return self.place is None or (self.film / "truth.json").exists()


def plain_case(recording: Path, work: Path) -> Case:
    """The recording as it is."""
    folder = work / recording.name / "plain"
    return Case(recording=recording, folder=folder, film=folder, strength_px=0.0, place=None)


def is_filmed(recording: Path) -> bool:
    """Whether it is no recording, but holds what was filmed elsewhere: 1px/truth.json and so on."""
    return any(recording.glob("*px/truth.json"))


def cases_of(recording: Path, options: argparse.Namespace) -> Iterator[Case]:
    """Those asked for; without a plume all places are one case."""
    elsewhere = is_filmed(recording)
    for strength_px in options.strengths:
        if strength_px == 0:
            if not elsewhere:
                yield plain_case(recording, options.work)
            continue
        for place in [0] if elsewhere else options.places:
            folder = options.work / recording.name / f"{strength_px:g}px_{place}"
            film = recording / f"{strength_px:g}px" if elsewhere else folder
            yield Case(
                recording=recording,
                folder=folder,
                film=film,
                strength_px=strength_px,
                place=place,
            )


def usable(options: argparse.Namespace) -> list[Path]:
    """The recordings that hold frames; why the others are left out is printed."""
    asked = options.recordings or sorted(path for path in RECORDINGS.glob("*") if path.is_dir())
    if not asked:
        print(f"skipped: no recordings given, and none in {RECORDINGS}")
    reasons = {path: why_skipped(path) for path in asked}
    for path, reason in reasons.items():
        if reason:
            print(f"{path.name} | skipped: {reason}", flush=True)
    return [path for path, reason in reasons.items() if not reason]


def why_skipped(recording: Path) -> str:
    """What is missing; empty where nothing is."""
    if not recording.is_dir():
        return f"no folder {recording}"
    if is_filmed(recording):
        return ""
    count = sum(path.suffix.lower() in PHOTO_SUFFIXES for path in recording.iterdir())
    if count < FEWEST:
        return f"{count} frames in it, at least {FEWEST} are needed"
    return ""


def add_case_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("recordings", type=Path, nargs="*", metavar="RECORDING")
    parser.add_argument("--work", type=Path, default=Path("work/real_frames"))
    parser.add_argument("--strengths", type=float, nargs="+", default=STRENGTHS_PX, help="px")
    parser.add_argument(
        "--places", type=int, nargs="+", choices=PLACES, default=PLACES, metavar="K"
    )
