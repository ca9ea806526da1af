"""The whole chain on random plants, with and without a leak, against the truth.

    python -m benchmarks.scenes orbit --work work/orbit
    python -m benchmarks.scenes orbit --seeds 1003 1004 --kinds leak
    python -m benchmarks.scenes orbit --seeds 1003 1004 --kinds pair    # two leaks 1 m apart
    python -m benchmarks.scenes orbit --seeds 1003 --nuisances people h264 --photos PHOTOS
    python -m benchmarks.scenes orbit --amplitude 0.3 --codings h264_0.2 --effort thorough

Each scene is 60 frames of 640x480 on an arc of 60 degrees, filmed losslessly; poses come from
structure from motion. Renderings are kept in the work folder and used again. `--nuisances` spoils
every scene by each of these in turn; what moves is covered with photos of the test split.
`--codings` codes each lossless recording anew, with so many bits a pixel.
"""

import argparse
import time
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product
from pathlib import Path

import numpy as np

from benchmarks.scenes import coding
from detect.synthesis.raster import find_photos
from geometry.errors import LocateError
from geometry.trajectory import Trajectory
from locate.evaluation import Evaluation, evaluate_map
from locate.map.plume import PlumeMap
from locate.pipeline.config import RunConfig
from locate.pipeline.run import Run
from locate.simulation import Scene, random_scene
from locate.simulation.capture import CaptureSetup
from locate.simulation.nuisances import NUISANCES, apply_nuisances
from locate.simulation.photo_scenes import PHOTOS_PER_SCENE
from locate.simulation.recording import write_recording
from locate.simulation.scene import CylinderObject

KINDS = ("leak", "pair", "clean")
SEEDS = (1003, 1004, 1008, 1009, 2000, 2001, 2002, 2003, 2004, 2005)


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """One scene: what came out, and what it cost."""

    evaluation: Evaluation | None
    plume_map: PlumeMap | None
    cpu_s: float
    failure: str = ""


def with_second(scene: Scene, gap_m: float) -> Scene:
    """A leak on a riser of its own, so far beside the first, to any side of it."""
    rng = scene.random_stream(25)
    (first,) = scene.plumes
    turn = rng.uniform(0, 2 * np.pi)
    x, y, z = first.source
    source = (x + gap_m * float(np.cos(turn)), y + gap_m * float(np.sin(turn)), z)
    riser = CylinderObject(
        kind="cylinder", start=(*source[:2], 0.0), end=source, radius_m=0.08, material="steel"
    )
    second = first.model_copy(
        update={
            "source": source,
            "radius_m": rng.uniform(0.1, 0.17),
            "height_m": rng.uniform(3.0, 4.0),
            "temperature_k": rng.uniform(360, 500),
            "flow_seed": int(rng.integers(2**31)),
        }
    )
    return scene.model_copy(update={"objects": (*scene.objects, riser), "plumes": (first, second)})


def render(folder: Path, scene: Scene, nuisance: str, photos: Sequence[Path]) -> None:
    if (folder / "truth.json").exists():
        return
    rng = scene.random_stream(24)
    some = rng.choice(len(photos), PHOTOS_PER_SCENE, replace=False) if photos else ()
    capture = CaptureSetup(scene=scene, photos=tuple(photos[i] for i in some))
    write_recording(apply_nuisances(capture, [nuisance] if nuisance else [], rng), folder)


def run(recording: Path, effort: str = coding.USUAL, *, resume: bool) -> Outcome:
    folder, output = recording.parent, coding.run_folder(recording, effort)
    settings = {"recording": recording, "effort": effort, "overlay": False}
    started = time.process_time()
    try:
        plume_map = Run(RunConfig.of(settings), output, force=not resume).run()
    except LocateError as error:
        cpu_s = time.process_time() - started
        return Outcome(evaluation=None, plume_map=None, cpu_s=cpu_s, failure=str(error))
    cpu_s = time.process_time() - started
    trajectory = Trajectory.load(output / "trajectory.json")
    evaluation = evaluate_map(plume_map, trajectory, folder, output / "detections")
    return Outcome(evaluation=evaluation, plume_map=plume_map, cpu_s=cpu_s)


def row(name: str, outcome: Outcome) -> str:
    if outcome.evaluation is None:
        return f"{name} | {outcome.failure}"
    evaluation = outcome.evaluation
    hits = "; ".join(
        f"{p.error:.3f} m, {p.error_percent:.2f} %, NEES {p.nees:.1f}" for p in evaluation.plumes
    )
    plumes = () if outcome.plume_map is None else outcome.plume_map.plumes
    index = ", ".join(plume.refractive_index or "not determined" for plume in plumes)
    auroc = evaluation.frame_median("auroc")
    precision = evaluation.frame_median("average_precision")
    return (
        f"{name} | {hits or '-'} | missed {len(evaluation.misses)} | "
        f"false {len(evaluation.false_plumes)} | index {index or '-'} | "
        f"AUROC {auroc:.3f} AP {precision:.3f} | {outcome.cpu_s:.0f} CPU s"
    )


def summary(leaks: list[Outcome], clean: list[Outcome]) -> str:
    scored = [o.evaluation for o in leaks if o.evaluation is not None]
    percent = [p.error_percent for e in scored for p in e.plumes]
    nees = [p.nees / 3 for e in scored for p in e.plumes]
    false_in_clean = sum(len(o.evaluation.false_plumes) for o in clean if o.evaluation)
    lines = [
        f"with leaks: found {len(percent)} of "
        f"{sum(len(e.plumes) + len(e.misses) for e in scored)} "
        f"({len(leaks) - len(scored)} runs failed), "
        f"false {sum(len(e.false_plumes) for e in scored)}",
        f"without: {false_in_clean} false plumes in {len(clean)} scenes",
    ]
    if percent:
        lines.append(
            f"source error, % of range: median {np.median(percent):.2f}, worst {max(percent):.2f}; "
            f"NEES/dof mean {np.mean(nees):.2f}, median {np.median(nees):.2f}"
        )
    return "\n".join(lines)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--seeds", type=int, nargs="+", default=SEEDS)
    parser.add_argument("--kinds", nargs="+", choices=KINDS, default=("leak", "clean"))
    parser.add_argument("--gap", type=float, default=1.0, help="between the leaks of a pair, m")
    parser.add_argument("--amplitude", type=float, default=1.0, help="px")
    parser.add_argument("--noise", type=float, default=1.0, help="of 255")
    parser.add_argument("--nuisances", nargs="+", choices=tuple(NUISANCES), default=("",))
    parser.add_argument("--photos", type=Path, help="for what moves")
    coding.add_arguments(parser)
    parser.add_argument("--resume", action="store_true", help="Keep the stages that stand.")
    parser.add_argument("--work", type=Path, default=Path("work/orbit"))


def main(options: argparse.Namespace) -> None:
    photos = find_photos(options.photos, "test") if options.photos else ()
    amplitude_px, noise = options.amplitude, options.noise
    outcomes: dict[bool, list[Outcome]] = {True: [], False: []}
    for seed, kind, nuisance in product(options.seeds, options.kinds, options.nuisances):
        plume = kind != "clean"
        label = f"{amplitude_px:g}px_{noise:g}" if plume else "clean"
        pair = f"pair{options.gap:g}m" if kind == "pair" else ""
        folder = options.work / "_".join(filter(None, (label, pair, nuisance, str(seed))))
        scene = random_scene(seed, plume=plume, amplitude_px=amplitude_px, noise=noise)
        if pair:
            scene = with_second(scene, options.gap)
        render(folder, scene, nuisance, photos)
        for name in options.codings:
            recording = coding.code(folder / "video.mkv", name)
            outcomes[plume].append(run(recording, options.effort, resume=options.resume))
            print(row(f"{folder.name} {name}", outcomes[plume][-1]), flush=True)
    print(summary(outcomes[True], outcomes[False]))
