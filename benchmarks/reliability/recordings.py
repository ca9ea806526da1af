"""The recordings: random plants and scenes of photos, four in ten without a plume.

A third are stored without loss, a third are coded, a third are filmed carelessly. Those of every
third flow are held out: their flows, scenes, photos and codec serve no choice.
"""

import argparse
from collections.abc import Sequence
from dataclasses import replace
from functools import cache, partial
from pathlib import Path

import numpy as np

from detect.synthesis.raster import find_photos
from detect.synthesis.sample import log_uniform
from detect.synthesis.split import Split
from locate.simulation import scene as simulated
from locate.simulation.capture import CaptureSetup
from locate.simulation.compression import VIDEO_BITS_PER_PIXEL, compress_h264, compress_h265
from locate.simulation.layouts import random_scene
from locate.simulation.nuisances import NUISANCES, apply_nuisances
from locate.simulation.photo_scenes import PHOTOS_PER_SCENE, make_photo_capture

SEEDS = range(340_000, 340_300)
FLOWS = 20
HELD_OUT = range(2, FLOWS, 3)
"""Of the flows."""
CONDITIONS = ("lossless", "coded", "careless")
PLUME_FREE = 0.4
AMPLITUDE_PX = (0.05, 1.0)
ARC_DEG = (20.0, 60.0)
NOISE = (0.5, 3.0)
CARELESS = tuple(name for name in NUISANCES if name != "h264")
MOST_NUISANCES = 2
FRAMES, KEYS = 24, 8
CAMERA = simulated.CameraBlock(width=320, height=240, focal_px=330)


def capture_of(seed: int, photos: Path) -> CaptureSetup:
    """What is filmed.

    Args:
        seed: Of the recording.
        photos: A folder of single photos, for scenes made of them and for what moves.
    """
    rng = np.random.default_rng([seed, 41])
    scene = random_scene(
        seed,
        plume=bool(rng.random() >= PLUME_FREE),
        amplitude_px=log_uniform(rng, AMPLITUDE_PX),
        noise=log_uniform(rng, NOISE),
        frames=FRAMES,
        arc_deg=float(rng.uniform(*ARC_DEG)),
    )
    scene = scene.model_copy(update={"camera": CAMERA})
    every = photos_of("test" if is_held_out(seed) else "train", photos)
    if rng.random() < 0.5:
        capture = make_photo_capture(scene, every)
    else:
        chosen = rng.choice(len(every), PHOTOS_PER_SCENE, replace=False)
        capture = CaptureSetup(scene=scene, photos=tuple(every[i] for i in chosen))
    plumes = tuple(flowing(plume, flow_of(seed)) for plume in capture.scene.plumes)
    capture = replace(capture, scene=capture.scene.model_copy(update={"plumes": plumes}))
    return _in_condition(capture, condition_of(seed), rng, is_held_out(seed))


def leak_of(seed: int) -> simulated.PlumeSpec:
    """The plume of a recording, or the one that would have stood there."""
    return flowing(random_scene(seed, plume=True).plumes[0], flow_of(seed))


def condition_of(seed: int) -> str:
    """One of `CONDITIONS`."""
    return CONDITIONS[(seed - SEEDS.start) // FLOWS % len(CONDITIONS)]


def flow_of(seed: int) -> int:
    """The seed of the flow that a plume shares with some others."""
    return SEEDS.start + (seed - SEEDS.start) % FLOWS


def is_held_out(seed: int) -> bool:
    """Whether a recording serves no choice."""
    return flow_of(seed) - SEEDS.start in HELD_OUT


def flowing(plume: simulated.PlumeSpec, flow_seed: int) -> simulated.PlumeSpec:
    """The plume with that flow, and with the exit that it comes out of."""
    other = random_scene(flow_seed, plume=True).plumes[0]
    exit_ = {name: getattr(other, name) for name in ("radius_m", "height_m", "temperature_k")}
    return plume.model_copy(update=exit_ | {"flow_seed": flow_seed})


@cache
def photos_of(split: Split, folder: Path) -> Sequence[Path]:
    """The photos of a split."""
    return find_photos(folder, split)


def _in_condition(
    capture: CaptureSetup, condition: str, rng: np.random.Generator, held_out: bool
) -> CaptureSetup:
    match condition:
        case "coded":
            compress = compress_h265 if held_out else compress_h264
            bits = log_uniform(rng, VIDEO_BITS_PER_PIXEL)
            return replace(capture, coding=partial(compress, bits_per_pixel=bits))
        case "careless":
            count = int(rng.integers(1, MOST_NUISANCES + 1))
            names = [str(name) for name in rng.choice(CARELESS, count, replace=False)]
            return apply_nuisances(capture, names, rng)
    return capture


def chosen(options: argparse.Namespace) -> list[int]:
    """The seeds of the flows asked for, those of one flow together: it is simulated once."""
    flows = [SEEDS.start + k for k in options.flows]
    return [seed for seed in sorted(SEEDS, key=flow_of) if flow_of(seed) in flows]


def add_recording_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--work", type=Path, default=Path("work/stated"))
    parser.add_argument("--photos", type=Path, default=Path("../shared/data/3_backgrounds"))
    parser.add_argument(
        "--flows", type=int, nargs="+", choices=range(FLOWS), default=range(FLOWS), metavar="K"
    )
