"""Experiment 3: a camera in the hand.

    OMP_NUM_THREADS=1 python -m benchmarks.paper moving [--picture PICTURE]

Prints a row for each scene, and draws one frame of each.
It walks past a wall of vertical waves, of a grid of squares, which no training sample shows, and
round a plant of brick, concrete and gravel; once with an exposure of 20 ms, otherwise without
motion blur.
"""

import argparse
from collections.abc import Iterator

import numpy as np

from benchmarks.paper.plate import NOISE
from benchmarks.paper.rows import (
    HEADER,
    AnsweredFrame,
    add_detector_arguments,
    draw_strip,
    score_row,
    write_picture,
)
from detect.detection import Frames
from detect.dybs import DybsDetector
from geometry.arrays import FloatMap, GreyImage
from locate.simulation.camera_paths import simulate_trajectory
from locate.simulation.layouts import random_scene
from locate.simulation.plume_field import PlumeField
from locate.simulation.render import Renderer
from locate.simulation.scene import (
    BoxObject,
    GroundObject,
    ImageBlock,
    PathBlock,
    PlumeSpec,
    Scene,
    VideoBlock,
    WallObject,
)
from locate.simulation.shutter import INSTANT, Shutter
from locate.simulation.surfaces import StaticSurfaces

VIEWS, EXPOSURE_S = 3, 0.02


def wall_scene(material: str, amplitude_px: float, *, start_deg: float = -100) -> Scene:
    """A printed wall behind a heat source on a box, the camera walking round them."""
    return Scene(
        seed=31,
        video=VideoBlock(frames=VIEWS, fps=1.5),
        image=ImageBlock(noise=NOISE),
        path=PathBlock(
            kind="handheld", target=(0, 0, 1.7), radius_m=3.4, height_m=1.5, start_deg=start_deg,
            arc_deg=20, jitter_m=0.03, jitter_deg=1.0,
        ),
        objects=(
            GroundObject(kind="ground", material="concrete"),
            WallObject(kind="wall", start=(-8, 1.5), end=(8, 1.5), height_m=6, material=material),
            BoxObject(kind="box", center=(0, 0, 0.35), size=(0.6, 0.6, 0.7), material="steel"),
        ),
        plumes=(PlumeSpec(source=(0, 0, 0.7), height_m=2.6, amplitude_px=amplitude_px),),
    )  # fmt: skip


def moving_scenes() -> dict[str, tuple[Scene, Shutter]]:
    plant = random_scene(5_000_031, plume=True, amplitude_px=0.6, noise=NOISE, frames=VIEWS)
    return {
        "waves, 0.6 px": (wall_scene("waves", 0.6), INSTANT),
        "waves, 0.6 px, aslant": (wall_scene("waves", 0.6, start_deg=-140), INSTANT),
        "waves, 0.6 px, motion blur": (wall_scene("waves", 0.6), Shutter(exposure_s=EXPOSURE_S)),
        "waves, 0.15 px": (wall_scene("waves", 0.15), INSTANT),
        "grid of squares, 0.6 px": (wall_scene("grid", 0.6), INSTANT),
        "plant, 0.6 px": (plant, INSTANT),
    }


def render_scene(scene: Scene, shutter: Shutter) -> Iterator[tuple[GreyImage, FloatMap]]:
    trajectory = simulate_trajectory(scene)
    fields = [PlumeField(scene, number) for number in range(len(scene.plumes))]
    renderer = Renderer(scene, StaticSurfaces(scene), fields, trajectory, shutter)
    for i in range(len(trajectory)):
        image, truth = renderer.render_frame(i)
        yield image, truth.displacement


def moving(detector: DybsDetector) -> list[np.ndarray]:
    print(HEADER.format(what="scene"))
    strips = []
    for name, (scene, shutter) in moving_scenes().items():
        seen = []
        for image, truth in render_scene(scene, shutter):
            everywhere = np.ones(image.shape, dtype=bool)
            answer = detector.detect(Frames(images=[image]), 0)
            seen.append(
                AnsweredFrame(
                    image=image, truth=truth, answer=answer, counts=everywhere, beside=~everywhere
                )
            )
        print(f"| {name} | {score_row(seen)} |", flush=True)
        strips.append(
            draw_strip(seen[1].image, seen[1].truth, seen[1].answer.displacement, side=200)
        )
    return strips


def add_arguments(parser: argparse.ArgumentParser) -> None:
    add_detector_arguments(parser)


def main(options: argparse.Namespace) -> None:
    write_picture(options.picture, moving(DybsDetector(options.network)))
