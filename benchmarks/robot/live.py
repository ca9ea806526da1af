"""A robot's camera at 30 Hz into a `Locator`: frames looked at, latency, memory.

    python -m benchmarks.robot live --seconds 60
    python -m benchmarks.robot live --seconds 300 --width 320 --plot memory.svg
    python -m benchmarks.robot live --replay 120 --width 320

The bundled recording is driven there and back, each frame shown twice; poses are the true ones.
Live, it comes in real time, and latency is from the stamp of the latest frame behind an update to
the update. A replay waits for nothing and drops nothing, until so many key frames have been looked
at: what they cost does not depend on what else the machine does.
"""

import argparse
import json
import os
import resource
import time
from collections.abc import Iterator
from itertools import cycle
from pathlib import Path

import numpy as np

from detect.detection import Detection, Detector, Frames
from detect.registry import make_detector
from geometry.arrays import FloatArray, GreyImage
from geometry.trajectory import Trajectory
from locate.recording import open_recording
from locate.recording.opening import ANY_SIDE
from locate.recording.sample import SAMPLE, SAMPLE_VIDEO
from locate.robot import Locator, LocatorSettings

RATE_HZ = 30
SHOWN = 2
SAMPLES = 60
NS = 1_000_000_000
SIGMAS = np.repeat([np.deg2rad(0.05), 0.005], 3)
COVARIANCE = np.diag(SIGMAS**2)


class Timed:
    """A detector that counts its CPU seconds."""

    def __init__(self, detector: Detector) -> None:
        self.name, self.response = detector.name, detector.response
        self.uses_other_frames = detector.uses_other_frames
        self.cpu_s: list[float] = []
        self._detector = detector

    def detect(self, frames: Frames, index: int) -> Detection:
        started = time.thread_time()
        detection = self._detector.detect(frames, index)
        self.cpu_s.append(time.thread_time() - started)
        return detection


def drive(truth: Trajectory) -> Iterator[tuple[GreyImage, FloatArray]]:
    images = [frame.image for frame in open_recording(SAMPLE_VIDEO, max_side=ANY_SIDE).frames()]
    rows = [*range(len(images)), *reversed(range(len(images)))]
    for row in cycle(np.repeat(rows, SHOWN)):
        pose = np.eye(4)
        pose[:3, :3], pose[:3, 3] = truth.rotations[row].T, truth.centers_in_world[row]
        yield images[row], pose


def processes() -> list[Path]:
    """This one, and the one that searches."""
    children = [path.read_text().split() for path in Path("/proc/self/task").glob("*/children")]
    return [Path("/proc/self"), *(Path("/proc", pid) for pids in children for pid in pids)]


def resident_mb() -> float:
    pages = sum(int((path / "statm").read_text().split()[1]) for path in processes())
    return pages * resource.getpagesize() / 1e6


def cpu_s() -> float:
    """Of all processes: fields 14 and 15 of stat, behind the name in brackets."""
    fields = [(path / "stat").read_text().rpartition(")")[2].split() for path in processes()]
    return sum(int(words[11]) + int(words[12]) for words in fields) / os.sysconf("SC_CLK_TCK")


def quantiles(values: list[float]) -> str:
    if not values:
        return "none"
    p50, p99 = np.percentile(values, [50, 99])
    return f"p50 {p50:.1f}, p99 {p99:.1f}, largest {max(values):.1f}"


def live(locator: Locator, truth: Trajectory, seconds: float) -> list[float]:
    """Feeds in real time; the memory at `SAMPLES` times, MB."""
    feeding_ms: list[float] = []
    latency_s: list[float] = []
    memory_mb: list[float] = []
    first_s: dict[str, float] = {}
    started, cpu = time.monotonic(), cpu_s()
    for count, (image, pose) in enumerate(drive(truth)):
        due = started + count / RATE_HZ
        time.sleep(max(0.0, due - time.monotonic()))
        now = time.monotonic()
        if now - started > seconds:
            break
        updates = locator.feed(image, pose, COVARIANCE, round((now - started) * NS))
        feeding_ms.append(1e3 * (time.monotonic() - now))
        latency_s += [time.monotonic() - started - update.stamp_ns / NS for update in updates]
        for update in updates:
            first_s.setdefault(update.state, round(time.monotonic() - started, 1))
        if count % max(round(seconds * RATE_HZ / SAMPLES), 1) == 0:
            memory_mb.append(resident_mb())
    spent, cpu = time.monotonic() - started, cpu_s() - cpu
    counts = locator.counts
    print(f"fed {counts.images / spent:.1f}/s, key frames {counts.key_frames / spent:.2f}/s")
    print(f"looked at {counts.looked_at / spent:.2f}/s, dropped {counts.dropped}")
    print(f"{cpu / spent:.2f} cores")
    print(f"feed, ms: {quantiles(feeding_ms)}")
    print(f"stamp to update, s: {quantiles(latency_s)}; first, s: {first_s}")
    return memory_mb


def replay(locator: Locator, truth: Trajectory, key_frames: int) -> list[float]:
    """Feeds until so many key frames have been looked at; the memory at `SAMPLES` times, MB."""
    memory_mb: list[float] = []
    for count, (image, pose) in enumerate(drive(truth)):
        locator.feed(image, pose, COVARIANCE, count * NS // RATE_HZ)
        share = locator.counts.looked_at / key_frames
        if share * SAMPLES >= len(memory_mb):
            memory_mb.append(resident_mb())
        if share >= 1:
            return memory_mb
    return memory_mb


def draw_memory(memory_mb: list[float], span: str) -> str:
    """The memory over the run as a drawing."""
    top = 1.2 * max(memory_mb)
    places = zip(np.linspace(50, 390, len(memory_mb)), memory_mb, strict=True)
    line = " ".join(f"{x:.0f},{180 - 160 * mb / top:.0f}" for x, mb in places)
    return (
        '<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 400 200" font-size="11">'
        '<path d="M50 20V180H390" fill="none" stroke="grey"/>'
        f'<polyline points="{line}" fill="none" stroke="crimson" stroke-width="2"/>'
        f'<text x="4" y="24">{top:.0f} MB</text><text x="40" y="184">0</text>'
        f'<text x="390" y="196" text-anchor="end">{span}</text></svg>\n'
    )


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--seconds", type=float, default=60)
    parser.add_argument("--replay", type=int, default=0, metavar="KEY_FRAMES")
    parser.add_argument("--width", type=int, default=LocatorSettings().width_px)
    parser.add_argument("--neighbours", type=int, default=LocatorSettings().neighbours)
    parser.add_argument("--lookers", type=int, default=LocatorSettings().detector_workers)
    parser.add_argument("--spacing", type=float, default=LocatorSettings().spacing)
    parser.add_argument("--lag", type=int, default=LocatorSettings().lag)
    parser.add_argument("--plain", action="store_true", help="judge by hand, not by the network")
    parser.add_argument("--plot", type=Path)


def main(options: argparse.Namespace) -> None:
    truth = Trajectory.from_dict(json.loads((SAMPLE / "truth.json").read_text()))
    settings = LocatorSettings(
        width_px=options.width,
        neighbours=options.neighbours,
        lag=options.lag,
        spacing=options.spacing,
        detector_workers=options.lookers,
    )
    name = "registered-plain" if options.plain else "registered"
    timed = Timed(make_detector(name, neighbours=options.neighbours))
    detector = timed if options.plain or options.replay else None
    started_s = cpu_s()
    with Locator(
        truth.camera, settings=settings, detector=detector, threaded=not options.replay
    ) as locator:
        if options.replay:
            memory_mb = replay(locator, truth, options.replay)
            look_s = np.array(timed.cpu_s)
            rest_s = (cpu_s() - started_s - look_s.sum()) / len(look_s)
            print(f"{name}, CPU s a key frame: p50 {np.median(look_s):.2f} to look at it,")
            print(f"  {rest_s:.2f} for all else: searches, following, intake")
        else:
            memory_mb = live(locator, truth, options.seconds)
    print(f"memory, MB, by tenths: {' '.join(f'{mb:.0f}' for mb in memory_mb[:: SAMPLES // 10])}")
    print(locator.counts)
    for plume in locator.plume_map().plumes:
        print(f"source {plume.source.round(2)}, sigma {plume.principal_sigmas[0]:.2f} m")
    if options.plot:
        looked_at = f"{locator.counts.looked_at} key frames looked at"
        span = looked_at if options.replay else f"{options.seconds / 60:.0f} min, {looked_at}"
        options.plot.write_text(draw_memory(memory_mb, span))
