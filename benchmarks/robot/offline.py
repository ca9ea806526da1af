"""A drive followed live against `locate run` on the same frames with the same poses.

    python -m benchmarks.robot offline                       # the bundled sample
    python -m benchmarks.robot offline SCENE [SCENE ...]     # folders that `locate simulate` wrote
    python -m benchmarks.robot offline SCENE --width 320 --neighbours 4 --lag 2

The poses are the true ones, said to be known to 5 mm and 0.05 degrees. No frame is dropped. The
two choose their frames each in its own way; the sources are compared by the sum of their
covariances (3 degrees of freedom), and each with the truth by its own.
"""

import argparse
import json
import tempfile
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

from detect.kinds import DYBS, REGISTERED, REGISTERED_PLAIN
from detect.registry import make_detector
from geometry.arrays import FloatArray
from geometry.trajectory import Trajectory
from locate.map.plume import Plume
from locate.pipeline.config import DetectorName, RunConfig
from locate.pipeline.run import Run
from locate.recording import open_recording
from locate.recording.opening import ANY_SIDE
from locate.recording.sample import SAMPLE, SAMPLE_VIDEO
from locate.robot import Locator, LocatorSettings

DETECTORS = (REGISTERED.name, REGISTERED_PLAIN.name, DYBS.name)
"""Those that need no view without the plume."""
SIGMAS = np.repeat([np.deg2rad(0.05), 0.005], 3)
NS = 1_000_000_000

Plumes = tuple[Plume, ...]


def offline(video: Path, truth: Trajectory, detector: DetectorName) -> Plumes:
    covariances = np.tile(np.diag(SIGMAS**2), (len(truth), 1, 1))
    with tempfile.TemporaryDirectory() as folder:
        poses = Path(folder) / "poses.json"
        replace(truth, covariances=covariances).save(poses)
        config = RunConfig(recording=video, poses=poses, detector=detector)
        return Run(config, Path(folder) / "run").run().plumes


def online(video: Path, truth: Trajectory, detector: str, settings: LocatorSettings) -> Plumes:
    locator = Locator(
        truth.camera,
        settings=settings,
        detector=make_detector(detector, neighbours=settings.neighbours),
        threaded=False,
    )
    rows = {int(index): row for row, index in enumerate(truth.indices)}
    for frame in open_recording(video, max_side=ANY_SIDE).frames():
        row, pose = rows[frame.index], np.eye(4)
        pose[:3, :3], pose[:3, 3] = truth.rotations[row].T, truth.centers_in_world[row]
        locator.feed(frame.image, pose, np.diag(SIGMAS**2), round(frame.time_s * NS))
    locator.finish()
    return locator.plume_map().plumes


def mahalanobis_squared(difference: FloatArray, covariance: FloatArray) -> float:
    return float(difference @ np.linalg.solve(covariance, difference))


def compare_plumes(name: str, live: Plumes, run: Plumes, sources: FloatArray) -> str:
    lines = [f"{name}: {len(live)} plumes live, {len(run)} offline, {len(sources)} true"]
    for source in sources if live and run else []:
        a, b = (min(p, key=lambda q: np.linalg.norm(q.source - source)) for p in (live, run))
        apart, off = a.source - b.source, a.source - source
        both = mahalanobis_squared(apart, a.source_covariance + b.source_covariance)
        lines.append(f"  apart {100 * np.linalg.norm(apart):.1f} cm, Mahalanobis^2 {both:.1f}")
        lines.append(f"  live off by {100 * off[0]:.0f}, {100 * off[1]:.0f}, {100 * off[2]:.0f} cm")
        for way, plume in (("live", a), ("offline", b)):
            error = mahalanobis_squared(plume.source - source, plume.source_covariance)
            lines.append(
                f"  {way:7} sigma {100 * plume.principal_sigmas[0]:.1f} cm, {len(plume.views)} "
                f"views, Mahalanobis^2 to the truth {error:.1f}"
            )
    return "\n".join(lines)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("scenes", nargs="*", type=Path)
    parser.add_argument("--detector", choices=DETECTORS, default=REGISTERED.name)
    for name in ("width_px", "neighbours", "lag"):
        option = f"--{name.removesuffix('_px')}"
        parser.add_argument(option, type=int, default=getattr(LocatorSettings(), name), dest=name)


def main(options: argparse.Namespace) -> None:
    settings = LocatorSettings(
        width_px=options.width_px, neighbours=options.neighbours, lag=options.lag
    )
    scenes = options.scenes or [SAMPLE]
    for scene in scenes:
        video = SAMPLE_VIDEO if scene == SAMPLE else scene / "video.mkv"
        content = json.loads((scene / "truth.json").read_text())
        truth = Trajectory.from_dict(content)
        sources = np.array([plume["source"] for plume in content["plumes"]])
        started = time.process_time()
        live = online(video, truth, options.detector, settings)
        middle = time.process_time()
        run = offline(video, truth, options.detector)
        costs = f"  CPU {middle - started:.0f} s live, {time.process_time() - middle:.0f} s offline"
        print(compare_plumes(scene.name, live, run, sources), costs, sep="\n", flush=True)
