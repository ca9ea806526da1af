"""Leaks as strong as physics makes them, at several sizes of frame and codings, against the truth.

    python -m benchmarks.scenes physical --sizes 640 --gases air --radii 0.12 --ranges 8.5
    python -m benchmarks.scenes physical --sizes 1920 --codings lossless h264_0.2 h265_0.1
    python -m benchmarks.scenes physical --sizes 1280 --gases none --codings h264_0.2

Random plants whose leak is air of 438 K, or methane as warm as the air around it, or that have
none; no strength is set in px. The lens is the same at each size, the noise 1/255 in every pixel.
Each leak and size is rendered once, losslessly, and kept in the work folder; other codings, with
that many bits a pixel, are made of it. A frame of 3840 px takes half a minute to render.
"""

import argparse
import json
from dataclasses import dataclass
from itertools import product
from pathlib import Path

from benchmarks.scenes import coding
from geometry.errors import LocateError
from geometry.refraction import AMBIENT_TEMPERATURE_K
from geometry.trajectory import Trajectory
from locate.evaluation import evaluate_map
from locate.pipeline.config import RunConfig
from locate.pipeline.run import Run
from locate.simulation import Scene, random_scene, simulate

TEMPERATURES_K = {"air": 438.0, "methane": AMBIENT_TEMPERATURE_K}
NO_LEAK = "none"
SIZES = {640: 480, 1280: 720, 1920: 1080, 3840: 2160}
"""Height of the frames of each width, px."""
FOCAL_WIDTHS = 560 / 640
"""Focal length of the lens, in widths of the frame."""


@dataclass(frozen=True, kw_only=True)
class Leak:
    """What leaks, if anything does, how wide, and how far away."""

    gas: str
    radius_m: float
    range_m: float

    def scene(self, seed: int, width: int, frames: int) -> Scene:
        scene = random_scene(seed, plume=self.gas != NO_LEAK, frames=frames)
        camera = scene.camera.model_copy(
            update={"width": width, "height": SIZES[width], "focal_px": FOCAL_WIDTHS * width}
        )
        plumes = tuple(
            plume.model_copy(
                update={
                    "gas": self.gas,
                    "temperature_k": TEMPERATURES_K[self.gas],
                    "radius_m": self.radius_m,
                    "amplitude_px": None,
                }
            )
            for plume in scene.plumes
        )
        path = scene.path.model_copy(update={"radius_m": self.range_m})
        return scene.model_copy(update={"camera": camera, "path": path, "plumes": plumes})

    def __str__(self) -> str:
        return f"{self.gas}_{self.radius_m:g}m_at_{self.range_m:g}m"


def film(folder: Path, scene: Scene) -> Path:
    """The lossless recording, rendered where it does not stand yet."""
    if not (folder / "truth.json").exists():
        simulate(scene, folder)
    return folder / "video.mkv"


def strength_px(folder: Path) -> float:
    """95th percentile of |w| over the plume, as physics made it; 0 without one."""
    plumes = json.loads((folder / "truth.json").read_text())["plumes"]
    return max((float(plume["amplitude_px"]) for plume in plumes), default=0.0)


def row(folder: Path, recording: Path, name: str, effort: str) -> str:
    """What a run makes of it: strength (p95), found, error, NEES, false, limit, CPU s."""
    output = coding.run_folder(recording, effort)
    settings = {"recording": recording, "effort": effort, "overlay": False}
    job = Run(RunConfig.of(settings), output, force=True)
    try:
        plume_map = job.run()
    except LocateError as error:
        return f"{name} | {error}"
    cpu_s = sum(stage.cpu_s for stage in job.folder.times)
    evaluation = evaluate_map(plume_map, Trajectory.load(output / "trajectory.json"), folder)
    found = "; ".join(f"{p.error_percent:.2f} %, NEES {p.nees:.1f}" for p in evaluation.plumes)
    missed = "missed" if evaluation.misses else "no leak"
    limit_px = plume_map.detection_limit_px
    return (
        f"{name} | {strength_px(folder):.3f} px | {found or missed} | "
        f"false {len(evaluation.false_plumes)} | "
        f"limit {'none' if limit_px is None else f'{limit_px:.3f} px'} | {cpu_s:.0f} CPU s"
    )


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--gases", nargs="+", choices=[*TEMPERATURES_K, NO_LEAK], default=["air"])
    parser.add_argument("--radii", type=float, nargs="+", default=[0.06, 0.12], help="m")
    parser.add_argument("--ranges", type=float, nargs="+", default=[5.0, 8.5, 15.0], help="m")
    parser.add_argument("--sizes", type=int, nargs="+", choices=list(SIZES), default=[640, 1280])
    parser.add_argument("--seeds", type=int, nargs="+", default=[13000])
    parser.add_argument("--frames", type=int, default=60)
    coding.add_arguments(parser)
    parser.add_argument("--work", type=Path, default=Path("work/physical"))


def main(options: argparse.Namespace) -> None:
    leaks = product(options.gases, options.radii, options.ranges)
    for (gas, radius_m, range_m), width, seed in product(leaks, options.sizes, options.seeds):
        leak = Leak(gas=gas, radius_m=radius_m, range_m=range_m)
        folder = options.work / f"{leak}_{width}px_{options.frames}_{seed}"
        lossless = film(folder, leak.scene(seed, width, options.frames))
        for name in options.codings:
            recording = coding.code(lossless, name)
            label = f"{leak} {width} px, {name}, {seed}"
            print(row(folder, recording, label, options.effort), flush=True)
