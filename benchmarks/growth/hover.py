"""What a whole run of a long video costs, of a camera that hovers between steps.

    python -m benchmarks.growth hover FILM [--frames 18000] [--max-frames 60]

FILM is the folder of a simulated scene. Each of its frames is shown for an equal share of the long
video (H.264, 30 a second), shaken by whole pixels and with grain of its own. Prints CPU and wall
seconds, the most memory of a process, the size of the video and of the run folder, and how far off
the sources are.
"""

import argparse
import json
import subprocess
import sys
import tempfile
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

from benchmarks.common.cost import children_cpu_s, children_peak_mib, folder_mib
from benchmarks.growth.looped import FPS
from geometry.arrays import GreyImage, IntArray
from geometry.processes import count_cores
from geometry.text_files import read_json
from geometry.trajectory import Trajectory
from locate.evaluation.api import evaluate
from locate.recording import open_recording
from locate.recording.opening import ANY_SIDE
from locate.recording.writer import H264, create_video

SHAKE_PX = 8
"""Most pixels by which a frame is shifted, either way."""
GRAIN, GRAINS = 1.5, 8
"""Standard deviation of the grain, grey levels, and how many patterns of it take turns."""
BITS_PER_PIXEL = 0.1
"""Of the coded video: of a drone's at a low bit rate."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("film", type=Path, help="folder of a scene made by `locate simulate`")
    parser.add_argument("--frames", type=int, default=18_000)
    parser.add_argument("--max-frames", type=int, default=60, help="key frames at most")


def main(options: argparse.Namespace) -> None:
    with tempfile.TemporaryDirectory() as name:
        work = Path(name)
        video = write_hover(options.film, work, options.frames)
        command = [sys.executable, "-m", "locate", "run", str(video), "-o", str(work / "run")]
        command += ["--max-frames", str(options.max_frames), "--no-overlay"]
        started_s = time.perf_counter()
        subprocess.run(command, check=True)
        wall_s = time.perf_counter() - started_s
        print(f"{options.frames} frames, {video.stat().st_size / 2**20:.0f} MiB of video")
        print(f"{children_cpu_s():.0f} CPU s, {wall_s:.0f} s on {count_cores()} cores")
        print(f"memory {children_peak_mib():.0f} MiB, disk {folder_mib(work / 'run'):.0f} MiB")
        scored = evaluate(work / "run", work)
        for plume in scored.plumes:
            print(f"source {plume.error_percent:.1f} % of the range off, NEES {plume.nees:.1f}")
        print(f"{len(scored.misses)} missed, {len(scored.false_plumes)} false")


def write_hover(film: Path, work: Path, count: int) -> Path:
    """The long video, and its truth beside it."""
    rng = np.random.default_rng(0)
    recording = open_recording(film / "video.mkv", max_side=ANY_SIDE)
    truth = read_json(film / "truth.json")
    trajectory = Trajectory.load(film / "truth.json")
    shown = np.arange(count) * len(trajectory) // count
    long = replace(trajectory.take(shown), indices=np.arange(count))
    text = json.dumps({**long.to_dict(), "plumes": truth["plumes"]})
    (work / "truth.json").write_text(text)
    shifts = shake(count, rng)
    first = next(iter(recording.frames())).image
    height, width = (side - 2 * SHAKE_PX for side in first.shape)
    grains = rng.normal(0, GRAIN, (GRAINS, height, width)).astype(np.int8)
    path = work / "video.mkv"
    coding = {"preset": "veryfast", "b": f"{BITS_PER_PIXEL * FPS * width * height:.0f}"}
    with create_video(path, size=(width, height), fps=FPS, options=coding, codec=H264) as video:
        for row, frame in enumerate(recording.frames()):
            for number in np.flatnonzero(shown == row).tolist():
                video.write(shot(frame.image, shifts[number], grains[number % GRAINS]))
    return path


def shake(count: int, rng: np.random.Generator) -> IntArray:
    """(N, 2) whole pixels along x and y, of a walk that stays near the middle."""
    walk = np.cumsum(rng.integers(-1, 2, (count, 2)), axis=0)
    period = 4 * SHAKE_PX
    return np.asarray(np.abs(walk % period - 2 * SHAKE_PX) - SHAKE_PX)


def shot(image: GreyImage, shift: IntArray, grain: np.ndarray) -> GreyImage:
    """The image without its rim, shifted, with grain."""
    height, width = grain.shape
    left, top = (shift + SHAKE_PX).tolist()
    part = image[top : top + height, left : left + width]
    return np.asarray(np.clip(part.astype(np.int16) + grain, 0, 255), np.uint8)
