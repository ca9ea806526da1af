"""Makes test clips of 320 x 240 px, a folder for each strength and noise.

    OMP_NUM_THREADS=1 python -m benchmarks.registered render FOLDER [--scenes 6]

Prints nothing; clips that are there are kept. Layouts of the same generator as the training's, of
seeds that nothing was trained, chosen or calibrated on (300000 and on), poses off by up to 0.1
degrees.
"""

import argparse
from pathlib import Path

from detect.learning.clips import clip_path

FIRST_SEED = 300_000
CONDITIONS = ((1.0, 1.0), (0.3, 1.0), (0.3, 3.0), (0.1, 1.0), (0.0, 1.0), (0.0, 3.0))


def name_of(amplitude_px: float, noise: float) -> str:
    return f"{amplitude_px:.1f}px_noise{noise:.0f}"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("folder", type=Path)
    parser.add_argument("--scenes", type=int, default=6)


def main(options: argparse.Namespace) -> None:
    from locate.simulation.capture import CaptureSetup, render_frames
    from locate.simulation.clips import draw_clip_scene, measure_clip

    for seed in range(FIRST_SEED, FIRST_SEED + options.scenes):
        for amplitude_px, noise in CONDITIONS:
            path = clip_path(options.folder / name_of(amplitude_px, noise), seed)
            if path.exists():
                continue
            path.parent.mkdir(parents=True, exist_ok=True)
            scene = draw_clip_scene(seed, plume=amplitude_px > 0)
            plumes = [p.model_copy(update={"amplitude_px": amplitude_px}) for p in scene.plumes]
            image = scene.image.model_copy(update={"noise": noise})
            scene = scene.model_copy(update={"plumes": plumes, "image": image})
            measure_clip(render_frames(CaptureSetup(scene=scene)), scene.random_stream(13)).save(
                path
            )
