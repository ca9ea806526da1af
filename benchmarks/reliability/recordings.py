"""The recordings: random plants, four in ten without a plume."""

import argparse
from pathlib import Path

import numpy as np

from detect.synthesis.sample import log_uniform
from locate.simulation import scene as simulated
from locate.simulation.layouts import random_scene

SEEDS = range(320_000, 320_100)
FLOWS = 20
PLUME_FREE = 0.4
AMPLITUDE_PX = (0.05, 1.0)
ARC_DEG = (20.0, 60.0)
NOISE = (0.5, 3.0)
FRAMES, KEYS = 24, 8
CAMERA = simulated.CameraBlock(width=320, height=240, focal_px=330)


def scene_of(seed: int) -> simulated.Scene:
    rng = np.random.default_rng([seed, 41])
    scene = random_scene(
        seed,
        plume=bool(rng.random() >= PLUME_FREE),
        amplitude_px=log_uniform(rng, AMPLITUDE_PX),
        noise=log_uniform(rng, NOISE),
        frames=FRAMES,
        arc_deg=float(rng.uniform(*ARC_DEG)),
    )
    plumes = tuple(flowing(plume, flow_of(seed)) for plume in scene.plumes)
    return scene.model_copy(update={"camera": CAMERA, "plumes": plumes})


def flow_of(seed: int) -> int:
    """The seed of the flow that a plume shares with four others at most."""
    return SEEDS.start + seed % FLOWS


def flowing(plume: simulated.PlumeSpec, flow_seed: int) -> simulated.PlumeSpec:
    """The plume with that flow, and with the exit that it comes out of."""
    other = random_scene(flow_seed, plume=True).plumes[0]
    exit_ = {name: getattr(other, name) for name in ("radius_m", "height_m", "temperature_k")}
    return plume.model_copy(update=exit_ | {"flow_seed": flow_seed})


def chosen(options: argparse.Namespace) -> list[int]:
    """The seeds of the flows asked for, those of one flow together."""
    flows = [SEEDS.start + k for k in options.flows]
    return [seed for seed in sorted(SEEDS, key=flow_of) if flow_of(seed) in flows]


def add_recording_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--work", type=Path, default=Path("work/stated"))
    parser.add_argument(
        "--flows", type=int, nargs="+", choices=range(FLOWS), default=range(FLOWS), metavar="K"
    )
