"""The cases: what is changed, one thing at a time, and the scenes of each."""

import argparse
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from zlib import crc32

import numpy as np

from detect.synthesis.raster import find_photos
from locate.simulation.capture import CaptureSetup
from locate.simulation.compression import compress_h264, compress_h265
from locate.simulation.layouts import random_scene
from locate.simulation.nuisances import NUISANCES, apply_nuisances
from locate.simulation.scene import CameraBlock, Scene

FIRST_SEED = 310_000
PICTURES = 4
BITS_A_PIXEL = 1e6 / (640 * 480 * 15)
"""Of a video of 1 Mbit/s at 640x480 px and 15 frames a second."""
CODINGS = {
    "h264_2mbit": partial(compress_h264, bits_per_pixel=2 * BITS_A_PIXEL),
    "h264_8mbit": partial(compress_h264, bits_per_pixel=8 * BITS_A_PIXEL),
}
RATES = {
    f"{name}_{bits:g}": partial(compress, bits_per_pixel=bits)
    for name, compress in (("h264", compress_h264), ("h265", compress_h265))
    for bits in (0.1, 0.2, 0.5)
}
"""Bits a pixel as phones and drones spend them."""
MOVING = ("people", "wind", "glints")
SPOILERS = (*[name for name in NUISANCES if name != "h264"], *CODINGS)


@dataclass(frozen=True, kw_only=True)
class Condition:
    """One case; `views` key frames of the sequence are judged."""

    amplitude_px: float = 0.3
    noise: float = 1.0
    arc_deg: float = 40.0
    nuisance: str = ""
    views: int = 8

    def sequence(self, seed: int) -> str:
        spoiler = self.nuisance or "calm"
        return f"{self.amplitude_px:g}px_{self.noise:g}_{self.arc_deg:g}deg_{spoiler}_{seed}"


@dataclass(frozen=True, kw_only=True)
class StudySize:
    """How large everything is."""

    seeds: int
    frames: int
    size: tuple[int, int]
    focal_px: float
    keys: int
    axes: dict[str, list[Condition]]


def axes(quick: bool) -> dict[str, list[Condition]]:
    strengths = (0.1, 0.3, 1.0) if quick else (0.05, 0.1, 0.2, 0.3, 0.5, 1.0, 2.0)
    strong = 1.0 if quick else 0.3
    spoilers = [Condition(amplitude_px=a, nuisance=n) for n in ("", *SPOILERS) for a in (strong, 0)]
    return {
        "amplitude": [Condition(amplitude_px=a) for a in strengths],
        "nuisance": spoilers,
        "coding": [Condition(nuisance=name) for name in ("", *RATES)],
        "views": [
            Condition(views=v) for v in ((1, 2, 4, 8) if quick else (1, 2, 4, 8, 16, 30, 60))
        ],
        "arc": [Condition(arc_deg=a) for a in ((15, 40, 90) if quick else (10, 20, 40, 90, 180))],
        "noise": [Condition(noise=n) for n in ((0.5, 1, 3) if quick else (0.5, 1, 2, 3, 5))],
    }


def scale_of(options: argparse.Namespace) -> StudySize:
    chosen = axes(options.quick)
    kept = {name: chosen[name] for name in options.axes}
    if options.quick:
        size = (320, 240)
        return StudySize(seeds=options.seeds, frames=24, size=size, focal_px=330, keys=8, axes=kept)
    size = (640, 480)
    return StudySize(seeds=options.seeds, frames=60, size=size, focal_px=560, keys=16, axes=kept)


def scene_of(condition: Condition, seed: int, scale: StudySize) -> Scene:
    scene = random_scene(
        seed,
        plume=condition.amplitude_px > 0,
        amplitude_px=condition.amplitude_px,
        noise=condition.noise,
        frames=scale.frames,
        arc_deg=condition.arc_deg,
    )
    width, height = scale.size
    camera = CameraBlock(width=width, height=height, focal_px=scale.focal_px)
    return scene.model_copy(update={"camera": camera})


def take_of(condition: Condition, scene: Scene, photos: Path | None) -> CaptureSetup:
    """The nuisance is the same with and without a plume."""
    rng = np.random.default_rng([scene.seed, crc32(condition.nuisance.encode())])
    capture = CaptureSetup(scene=scene)
    if condition.nuisance in MOVING:
        if photos is None:
            raise SystemExit(f"{condition.nuisance} needs --photos")
        every = find_photos(photos, "test")
        if len(every) < PICTURES:
            raise SystemExit(f"{photos}: {len(every)} photos of the test split, give {PICTURES}")
        chosen = rng.choice(len(every), PICTURES, replace=False)
        capture = replace(capture, photos=tuple(every[i] for i in chosen))
    coding = (CODINGS | RATES).get(condition.nuisance)
    if coding is not None:
        return replace(capture, coding=coding)
    return apply_nuisances(capture, [condition.nuisance] if condition.nuisance else [], rng)


def sequences(scale: StudySize) -> Iterator[tuple[str, Condition, int]]:
    for axis, conditions in scale.axes.items():
        for seed in range(FIRST_SEED, FIRST_SEED + scale.seeds):
            for condition in conditions:
                yield axis, condition, seed


def add_case_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--quick", action="store_true", help="few cases, small frames")
    parser.add_argument("--work", type=Path, default=Path("work/seeing"))
    parser.add_argument("--photos", type=Path, help="single photos, for what moves")
    parser.add_argument("--seeds", type=int, default=2, help="scenes a case")
    parser.add_argument("--axes", nargs="+", default=list(axes(True)), choices=list(axes(True)))
