"""Mean probability of refraction on undistorted images that are merely shifted.

    python -m benchmarks.single_frame shift --networks A.onnx [B.onnx ...] [--photos PHOTOS]

Prints it for each network, kind of background and shift, and how far the share of the pixels in the
default mask changes with the shift; `refinement` is the network for patterns.
"""

import argparse
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from benchmarks.single_frame.contenders import MASK_NATS
from detect.dybs import DybsDetector
from detect.dybs.estimator import Estimate
from detect.synthesis import FAMILIES, Recipe, Sources
from detect.synthesis.camera import MARGIN_PX, CameraOptics, expose_background
from detect.synthesis.recipe import Family
from detect.synthesis.sample import draw_background
from geometry.arrays import GreyImage

SHIFTS_PX = (0.0, 0.125, 0.25, 0.5)
BACKGROUNDS = 12


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--networks", nargs="+", type=Path, required=True)
    parser.add_argument("--photos", type=Path)


def main(options: argparse.Namespace) -> None:
    print("| network | background | " + " | ".join(f"{s} px" for s in SHIFTS_PX)
          + " | largest change | of the mask's llr > 2 |\n|" + "---|" * 8)  # fmt: skip
    detectors = [DybsDetector(path) for path in options.networks]
    for family in FAMILIES:
        if family == "photo" and not options.photos:
            continue
        recipe = Recipe(families={family: 1}, split="test", photos=options.photos)
        shifted = [shifted_images(recipe, family, px) for px in SHIFTS_PX]
        for detector in detectors:
            estimates = [
                [detector.estimator.estimate(image) for image in images] for images in shifted
            ]
            masked = [np.mean([detector.to_detection(one).llr > MASK_NATS for one in some])
                      for some in estimates]  # fmt: skip
            change = f"{np.ptp(masked):.4f}"
            print_shift(
                detector.estimator.network.name,
                family,
                [stated(some, 0) for some in estimates],
                change,
            )
        print_shift("refinement", family, [stated(some, 1) for some in estimates], "")


def stated(estimates: Sequence[Estimate], score: int) -> float:
    """Mean probability by one of the scores, where there is one."""
    logits = np.concatenate([estimate.scores[..., score].ravel() for estimate in estimates])
    known = logits != 0
    return float(np.mean(1 / (1 + np.exp(-logits[known])))) if known.any() else float("nan")


def print_shift(name: str, family: str, means: Sequence[float], change: str) -> None:
    if np.isfinite(means).all():
        print(f"| {name} | {family} | " + " | ".join(f"{p:.4f}" for p in means)
              + f" | {np.ptp(means):.4f} | {change} |", flush=True)  # fmt: skip


def shifted_images(recipe: Recipe, family: Family, shift_px: float) -> list[GreyImage]:
    """The same backgrounds, noise and camera at every shift."""
    sources = Sources.from_recipe(recipe)
    side = recipe.size_px + 2 * MARGIN_PX
    still, images = np.zeros((side, side, 2), np.float32), []
    for number in range(BACKGROUNDS):
        rng = np.random.default_rng([7, number])
        background = draw_background(family, rng, recipe, sources)
        optics = CameraOptics(noise=1.0)
        images.append(expose_background(background, [still], np.array([shift_px, 0]), optics, rng))
    return images
