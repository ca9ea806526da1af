"""Runs longer and longer recordings, and fits how time, memory and disk space grow.

    python -m benchmarks.growth run [--lengths N...] [--photos N...] [--recording R] [--width PX]

`--lengths`: frames of a video of which twelve key frames are chosen, and nothing more is done.
`--photos`: so many photos, all of them key frames, through the whole run. Both show the frames of
the recording to and fro. An exponent is the slope of the logarithm over all sizes: 1 is linear.
"""

import argparse
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import chain, cycle, islice
from pathlib import Path

import cv2
import numpy as np

from benchmarks.common.cost import children_peak_mib, peak_mib
from geometry.arrays import GreyImage
from geometry.processes import call_apart
from locate.journal.progress import silent
from locate.pipeline.config import RunConfig
from locate.pipeline.run import Run
from locate.recording import open_recording
from locate.recording.sample import SAMPLE_VIDEO
from locate.recording.writer import LOSSLESS, open_video

KEY_FRAMES = 12
SMOOTHED = 1e-2
"""CPU seconds under which a stage has no measurable growth."""


@dataclass(frozen=True, kw_only=True)
class Spent:
    """What a run cost.

    Attributes:
        cpu_s: Of each stage.
        peak_mib: The most memory of its process.
        sfm_mib: The most memory of the process of structure from motion.
        disk_mib: What its folder holds.
    """

    cpu_s: dict[str, float]
    peak_mib: float
    sfm_mib: float
    disk_mib: float

    @property
    def numbers(self) -> dict[str, float]:
        """All of them by what a column is called."""
        memory = {"MiB": self.peak_mib, "MiB, COLMAP": self.sfm_mib, "disk MiB": self.disk_mib}
        return {f"{name} CPU s": spent for name, spent in self.cpu_s.items()} | memory


def spend(recording: Path, output: Path, most: int, *, whole: bool, **_progress: object) -> Spent:
    """Runs, in a process of its own."""
    run = Run(RunConfig(recording=recording, max_frames=most), output, report=silent)
    if whole:
        run.run()
    else:
        run.prepare(poses=False)
    files = [path for path in output.rglob("*") if path.is_file()]
    return Spent(
        cpu_s={time.name: time.cpu_s for time in run.folder.times},
        peak_mib=peak_mib(),
        sfm_mib=children_peak_mib(),
        disk_mib=sum(path.stat().st_size for path in files) / 2**20,
    )


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--recording", type=Path, default=SAMPLE_VIDEO)
    parser.add_argument("--width", type=int, default=240, help="px of the frames")
    parser.add_argument("--lengths", type=int, nargs="*", default=[60, 240, 960])
    parser.add_argument("--photos", type=int, nargs="*", default=[10, 20, 40])


def main(options: argparse.Namespace) -> None:
    images = shrunk(options.recording, options.width)
    with tempfile.TemporaryDirectory() as work:
        for title, counts, write, whole in (
            ("frames of a video", options.lengths, write_video, False),
            ("photos", options.photos, write_photos, True),
        ):
            spent = []
            for count in counts:
                folder = Path(work) / f"{title}_{count}"
                folder.mkdir()
                recording = write(folder, islice(to_and_fro(images), count))
                most = count if whole else KEY_FRAMES
                spent.append(
                    call_apart(
                        spend,
                        recording,
                        folder / "out",
                        most,
                        whole=whole,
                        name="a run",
                        report=silent,
                    ).numbers
                )
            if counts:
                print_table(title, counts, spent)


def shrunk(recording: Path, width: int) -> list[GreyImage]:
    """The frames, so wide."""
    images = [frame.image for frame in open_recording(recording).frames()]
    size = (width, round(images[0].shape[0] * width / images[0].shape[1]))
    return [np.asarray(cv2.resize(i, size, interpolation=cv2.INTER_AREA), np.uint8) for i in images]


def to_and_fro(images: Sequence[GreyImage]) -> Iterator[GreyImage]:
    """Without end."""
    return cycle(chain(images, images[-2:0:-1]))


def write_video(folder: Path, images: Iterator[GreyImage]) -> Path:
    first = next(images)
    path, size = folder / "video.mkv", (first.shape[1], first.shape[0])
    with open_video(path, size=size, fps=30.0, codec=LOSSLESS) as video:
        for image in chain([first], images):
            video.write(image)
    return path


def write_photos(folder: Path, images: Iterator[GreyImage]) -> Path:
    path = folder / "photos"
    path.mkdir()
    for number, image in enumerate(images):
        cv2.imwrite(str(path / f"{number:06d}.png"), image)
    return path


def print_table(title: str, counts: Sequence[int], spent: Sequence[dict[str, float]]) -> None:
    names = list(spent[0])
    print(f"| {title} | {' | '.join(names)} |\n|{'---|' * (len(names) + 1)}")
    for count, numbers in zip(counts, spent, strict=True):
        print(f"| {count} | {' | '.join(f'{numbers[name]:.1f}' for name in names)} |")
    slopes = [exponent(counts, [numbers[name] for numbers in spent]) for name in names]
    print(f"| exponent | {' | '.join(slopes)} |\n", flush=True)


def exponent(counts: Sequence[int], values: Sequence[float]) -> str:
    """Slope of the logarithm of the values over that of the counts."""
    if len(counts) < 2 or min(values) < SMOOTHED:
        return "-"
    return f"{np.polyfit(np.log(counts), np.log(values), 1)[0]:.2f}"
