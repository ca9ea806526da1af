"""Runs longer and longer recordings, and fits how time, memory and disk space grow.

    python -m benchmarks.growth run [--lengths N...] [--folders N...] [--photos N...]
                                    [--recording R] [--width PX] [--keep N] [--out DIR]

Writes growth_video.csv, growth_folders.csv and growth_photos.csv, of the options that name sizes.
`--lengths`: frames of a video (H.264, 30 a second) of which `--keep` key frames are chosen, and
nothing more is done. `--folders`: the same of so many photos. `--photos`: so many photos, all of
them key frames, through the whole run. All show the frames of the recording to and fro. An exponent
is the slope of the logarithm over all sizes: 1 is linear. `decoding` is what it takes to decode the
video, or to read the photos, once.
"""

import argparse
import tempfile
import time
from collections import defaultdict
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import chain, cycle, islice
from pathlib import Path

import av
import cv2
import numpy as np

from benchmarks.common.cost import children_peak_mib, folder_mib, peak_mib
from benchmarks.common.csv_tables import DOCS, write_table
from benchmarks.common.growth import growth_rows
from benchmarks.growth.looped import loop_video, write_unit
from geometry.arrays import GreyImage
from geometry.image_files import write_image
from geometry.processes import call_apart
from geometry.reports import ignore_report
from locate.pipeline.config import RunConfig
from locate.pipeline.run import Run
from locate.recording import open_recording
from locate.recording.images import read_grey
from locate.recording.sample import SAMPLE_VIDEO

CPU, MEMORY, DISK = "CPU s", "MiB", "disk MiB"
"""Columns: of all stages, of the process itself, of the run folder."""


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
        memory = {MEMORY: self.peak_mib, "MiB, COLMAP": self.sfm_mib, DISK: self.disk_mib}
        stages = {f"{name} {CPU}": spent for name, spent in self.cpu_s.items()}
        return {CPU: sum(self.cpu_s.values())} | stages | memory


def run_apart(config: RunConfig, output: Path, *, whole: bool = True) -> Spent:
    """What a run costs, in a process of its own; not `whole`: until its key frames are chosen."""
    return call_apart(spend, config, output, whole=whole, name="a run", report=ignore_report)


def spend(config: RunConfig, output: Path, *, whole: bool, **_progress: object) -> Spent:
    """What `run_apart` calls."""
    run = Run(config, output, report=ignore_report)
    if whole:
        run.run()
    else:
        run.prepare(poses=False)
    cpu_s: dict[str, float] = defaultdict(float)
    for stage in run.folder.times:
        cpu_s[stage.name] += stage.cpu_s
    return Spent(
        cpu_s=dict(cpu_s),
        peak_mib=peak_mib(),
        sfm_mib=children_peak_mib(),
        disk_mib=folder_mib(output),
    )


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--recording", type=Path, default=SAMPLE_VIDEO)
    parser.add_argument("--width", type=int, default=240, help="px of the frames")
    parser.add_argument("--keep", type=int, default=12, help="key frames chosen of the first two")
    parser.add_argument("--lengths", type=int, nargs="*", default=[60, 240, 960])
    parser.add_argument("--folders", type=int, nargs="*", default=[30, 120, 480])
    parser.add_argument("--photos", type=int, nargs="*", default=[10, 20, 40])
    parser.add_argument("--out", type=Path, default=DOCS)


def main(options: argparse.Namespace) -> None:
    images = shrunk(options.recording, options.width)
    with tempfile.TemporaryDirectory() as work:
        unit = write_unit(Path(work) / "unit.mkv", images)
        for name, title, counts, write in (
            ("video", "frames of a video", options.lengths, partial(write_video, unit)),
            ("folders", "photos, few kept", options.folders, partial(write_photos, images)),
            ("photos", "photos", options.photos, partial(write_photos, images)),
        ):
            whole = name == "photos"
            costs = [
                measure(write, Path(work), count, count if whole else options.keep, whole=whole)
                for count in counts
            ]
            if counts:
                write_table(options.out / f"growth_{name}.csv", growth_rows(title, counts, costs))


def measure(
    write: Callable[[Path, int], Path], work: Path, count: int, most: int, *, whole: bool
) -> dict[str, float]:
    """The columns of a row; what it was measured on is removed."""
    with tempfile.TemporaryDirectory(dir=work) as place:
        recording = write(Path(place), count)
        decoding_s = call_apart(decode, recording, name="decoding", report=ignore_report)
        config = RunConfig(recording=recording, max_frames=most)
        spent = run_apart(config, Path(place) / "out", whole=whole)
    return {"decoding CPU s": decoding_s} | spent.numbers


def decode(recording: Path, **_progress: object) -> float:
    """CPU s of decoding a video, or of reading photos, once."""
    started_s = time.process_time()
    if recording.is_dir():
        for photo in recording.iterdir():
            read_grey(photo)
    else:
        with av.open(str(recording)) as container:
            for _ in container.decode(video=0):
                pass
    return time.process_time() - started_s


def shrunk(recording: Path, width: int) -> list[GreyImage]:
    """The frames, so wide."""
    images = [frame.image for frame in open_recording(recording).frames()]
    size = (width, round(images[0].shape[0] * width / images[0].shape[1]))
    return [np.asarray(cv2.resize(i, size, interpolation=cv2.INTER_AREA), np.uint8) for i in images]


def write_video(unit: Path, folder: Path, count: int) -> Path:
    """A video of so many frames, of those of the unit."""
    return loop_video(unit, folder / "video.mkv", count)


def write_photos(images: Sequence[GreyImage], folder: Path, count: int) -> Path:
    """So many photos, to and fro."""
    path = folder / "photos"
    path.mkdir()
    for number, image in enumerate(islice(cycle(chain(images, images[-2:0:-1])), count)):
        write_image(path / f"{number:06d}.jpg", image)
    return path
