"""What a whole run costs against the size of the frames.

    python -m benchmarks.growth sizes FILM --widths 640 1280 1920 3840 [--out DIR]

FILM is the folder of a simulated scene, its frames as wide as the widest or wider. They are shrunk
to each width (means of the pixels that fall on one) and coded losslessly (FFV1). Each video goes
through the whole run, with one process, no overlay video and a camera that is not known. Writes
growth_sizes.csv: CPU seconds of all stages and of each, memory, disk, in how many frames refraction
was measured (+ those that fusion asks for where these leave doubt), the strength of the plume, and
how far off its source is. The exponents are over pixels.
"""

import argparse
import re
import tempfile
from pathlib import Path

import cv2
import numpy as np

from benchmarks.common.csv_tables import DOCS, Row, write_table
from benchmarks.common.edited import video_of
from benchmarks.common.growth import growth_rows
from benchmarks.growth.run import run_apart
from benchmarks.scenes.physical import strength_px
from geometry.trajectory import Trajectory
from locate.evaluation.evaluation import evaluate_map
from locate.map.plume import PlumeMap
from locate.pipeline.config import RunConfig
from locate.pipeline.files import RunFiles
from locate.recording import open_recording
from locate.recording.opening import ANY_SIDE
from locate.recording.writer import LOSSLESS, create_video

MORE = r"(\d+) more frames"
"""What a map says of the frames of which the displacement alone was measured."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("film", type=Path, help="folder of a scene made by `locate simulate`")
    parser.add_argument("--widths", type=int, nargs="+", default=[640, 1280, 1920, 3840], help="px")
    parser.add_argument("--out", type=Path, default=DOCS)


def main(options: argparse.Namespace) -> None:
    megapixels: list[float] = []
    costs: list[dict[str, float]] = []
    told: list[Row] = []
    for width in options.widths:
        with tempfile.TemporaryDirectory() as work:
            video, size = write_shrunk(options.film, Path(work), width)
            spent = run_apart(RunConfig(recording=video, overlay=False), Path(work) / "run")
            megapixels.append(size[0] * size[1] / 1e6)
            costs.append(spent.numbers)
            told.append(
                {"size": "x".join(map(str, size))}
                | outcome(options.film, Path(work) / "run", width)
            )
            print(told[-1], costs[-1], flush=True)
    rows = growth_rows("megapixels", megapixels, costs, told)
    write_table(options.out / "growth_sizes.csv", rows)


def write_shrunk(film: Path, folder: Path, width: int) -> tuple[Path, tuple[int, int]]:
    """The film as a lossless video so wide, and its width and height."""
    recording = open_recording(video_of(film), max_side=ANY_SIDE)
    trajectory = Trajectory.load(film / "truth.json")
    camera = trajectory.camera.scaled(width / trajectory.camera.width)
    size = camera.width, camera.height
    fps = 1 / float(np.median(np.diff(trajectory.times_s)))
    video = folder / "video.mkv"
    with create_video(video, size=size, fps=fps, codec=LOSSLESS) as target:
        for frame in recording.frames():
            shrunk = cv2.resize(frame.image, size, interpolation=cv2.INTER_AREA)
            target.write(np.asarray(shrunk, np.uint8))
    return video, size


def outcome(film: Path, run: Path, width: int) -> Row:
    """The strength of the plume in a film so wide, and what a run of it found."""
    files = RunFiles(run)
    found = PlumeMap.load(files.map)
    scored = evaluate_map(found, Trajectory.load(files.trajectory), film)
    errors = [f"{plume.error_percent:.1f}" for plume in scored.plumes]
    filmed_px = Trajectory.load(film / "truth.json").camera.width
    measured = len(list(files.detections.glob("*.npz")))
    more = re.search(MORE, " ".join(found.notes))
    return {
        "frames measured": f"{measured} + {more[1]}" if more else str(measured),
        "strength, px": f"{strength_px(film) * width / filmed_px:.3f}",
        "source off, % of the range": "; ".join(errors) or "missed",
        "false": str(len(scored.false_plumes)),
    }
