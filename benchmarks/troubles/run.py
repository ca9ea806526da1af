"""Spoils recordings in each way, runs `locate run` on each, and prints a table.

    python -m benchmarks.troubles run [RECORDING...] [--troubles NAME...] [--frames 40]

Of a row: the error of the source in percent of its range where the truth is known, the plumes that
are none with their stated probabilities, why there is no map, CPU seconds. `--width` shrinks wider
recordings.
"""

import argparse
import tempfile
from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np

from benchmarks.troubles.images import TROUBLES
from geometry.arrays import GreyImage
from geometry.errors import LocateError
from locate.evaluation.api import evaluate
from locate.journal.costs import cpu_seconds
from locate.pipeline.config import RunConfig
from locate.pipeline.run import Run
from locate.recording import open_recording
from locate.recording.sample import SAMPLE_VIDEO
from locate.recording.writer import LOSSLESS, create_video

WRONG_FOCAL = 1.0
"""In longer sides of the image; the sample's is 0.875."""
FPS = 10.0
"""Of recordings that are photos."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("recordings", type=Path, nargs="*", default=[SAMPLE_VIDEO])
    parser.add_argument("--troubles", nargs="+", choices=TROUBLES, default=list(TROUBLES))
    parser.add_argument("--frames", type=int, default=40, help="key frames at most")
    parser.add_argument("--width", type=int, default=640, help="px, to which wider ones are shrunk")


def main(options: argparse.Namespace) -> None:
    print("| recording | trouble | error, % | NEES | missed | false | ends | CPU s |")
    print("|---|---|---|---|---|---|---|---|", flush=True)
    for recording in options.recordings:
        images = read_shrunk(recording, options.width)
        for name in options.troubles:
            started_s = cpu_seconds()
            with tempfile.TemporaryDirectory() as work:
                found = find_plumes(recording, images, name, Path(work), options.frames)
            spent_s = cpu_seconds() - started_s
            print(f"| {recording.stem} | {name} | {found} | {spent_s:.0f} |", flush=True)


def read_shrunk(recording: Path, most_width: int) -> list[GreyImage]:
    """Its frames, at most so wide."""
    images = [frame.image for frame in open_recording(recording).frames()]
    height, width = images[0].shape
    size = (most_width, round(height * most_width / width))
    if width <= most_width:
        return images
    return [np.asarray(cv2.resize(i, size, interpolation=cv2.INTER_AREA), np.uint8) for i in images]


def find_plumes(
    recording: Path, images: list[GreyImage], trouble: str, work: Path, max_frames: int
) -> str:
    """The cells of a row that tell what a run found."""
    height, width = images[0].shape
    with create_video(work / "video.mkv", size=(width, height), fps=FPS, codec=LOSSLESS) as video:
        for image in TROUBLES[trouble](images, np.random.default_rng(0)):
            video.write(image)
    focal_px = WRONG_FOCAL * max(height, width) if trouble == "wrong_focal" else None
    config = RunConfig(recording=work / "video.mkv", focal_px=focal_px, max_frames=max_frames)
    try:
        plume_map = Run(config, work / "run").run()
    except LocateError as error:
        return f"| | | | {' '.join(str(error).split())}"
    probable = {plume.id: plume.probability for plume in plume_map.plumes}
    if not (recording.parent / "truth.json").exists():
        return f"| | | {_count(list(probable.values()))} | map"
    verdict = evaluate(work / "run", recording.parent)
    errors = ", ".join(f"{plume.error_percent:.1f}" for plume in verdict.plumes)
    nees = ", ".join(f"{plume.nees:.1f}" for plume in verdict.plumes)
    false = _count([probable[number] for number in verdict.false_plumes])
    return f"{errors} | {nees} | {len(verdict.misses)} | {false} | map"


def _count(probabilities: Sequence[float]) -> str:
    """How many plumes, and how probable each is said to be."""
    said = ", ".join(f"{probability:.2f}" for probability in probabilities)
    return f"{len(probabilities)} ({said})" if said else "0"
