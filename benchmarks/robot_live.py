"""A robot's camera at 30 Hz into a `Locator`: frames looked at, latency, memory.

    python benchmarks/robot_live.py --seconds 60
    python benchmarks/robot_live.py --seconds 1200 --width 320

The bundled recording is driven there and back, in real time, each frame shown twice; poses are the
true ones. Latency is from the stamp of the latest frame behind an update to the update.
"""

import argparse
import json
import resource
import time
from collections.abc import Iterator
from itertools import cycle
from pathlib import Path

import numpy as np

from geometry.arrays import FloatArray, GreyImage
from geometry.trajectory import Trajectory
from locate.robot import Locator, Settings
from locate.sample import SAMPLE, SAMPLE_VIDEO
from locate.video import open_recording

RATE_HZ = 30
SHOWN = 2
NS = 1_000_000_000
SIGMAS = np.repeat([np.deg2rad(0.05), 0.005], 3)


def drive(truth: Trajectory) -> Iterator[tuple[GreyImage, FloatArray]]:
    images = [frame.image for frame in open_recording(SAMPLE_VIDEO, max_side=1 << 16).frames()]
    rows = [*range(len(images)), *reversed(range(len(images)))]
    for row in cycle(np.repeat(rows, SHOWN)):
        pose = np.eye(4)
        pose[:3, :3], pose[:3, 3] = truth.rotations[row].T, truth.centers_in_world[row]
        yield images[row], pose


def resident_mb() -> float:
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * resource.getpagesize() / 1e6


def quantiles(values: list[float]) -> str:
    if not values:
        return "none"
    p50, p99 = np.percentile(values, [50, 99])
    return f"p50 {p50:.1f}, p99 {p99:.1f}, largest {max(values):.1f}"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=60)
    parser.add_argument("--width", type=int, default=640)
    arguments = parser.parse_args()
    truth = Trajectory.from_dict(json.loads((SAMPLE / "truth.json").read_text()))
    settings = Settings(width_px=arguments.width)
    feeding_ms: list[float] = []
    latency_s: list[float] = []
    memory_mb: list[float] = []
    with Locator(truth.camera, settings=settings) as locator:
        started, cpu = time.monotonic(), time.process_time()
        for count, (image, pose) in enumerate(drive(truth)):
            due = started + count / RATE_HZ
            time.sleep(max(0.0, due - time.monotonic()))
            now = time.monotonic()
            if now - started > arguments.seconds:
                break
            news = locator.feed(image, pose, np.diag(SIGMAS**2), round((now - started) * NS))
            feeding_ms.append(1e3 * (time.monotonic() - now))
            latency_s += [time.monotonic() - started - update.stamp_ns / NS for update in news]
            if count % (60 * RATE_HZ) == 0:
                memory_mb.append(resident_mb())
                print(f"{count / RATE_HZ / 60:4.0f} min  {memory_mb[-1]:6.0f} MB", flush=True)
        seconds, cpu = time.monotonic() - started, time.process_time() - cpu
        counts = locator.counts
    print(f"fed {counts.images / seconds:.1f}/s, key frames {counts.key_frames / seconds:.2f}/s")
    print(f"looked at {counts.looked_at / seconds:.2f}/s, dropped {counts.dropped}")
    print(
        f"CPU {cpu / max(counts.looked_at, 1):.2f} s a frame looked at, {cpu / seconds:.2f} cores"
    )
    print(f"feed, ms: {quantiles(feeding_ms)}")
    print(f"stamp to update, s: {quantiles(latency_s)}")
    print(counts)


if __name__ == "__main__":
    main()
