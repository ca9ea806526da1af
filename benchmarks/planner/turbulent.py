"""Turbulent plumes: the planned strength beside that of single frames and of their mean.

    python -m benchmarks.planner turbulent

Ten flows of 30 CPU s, each seen by three cameras in six frames, half a second apart. A strength is
the 95th percentile over the plume's image, without a window of measurement; of single frames the
mean, least and most.
"""

import argparse

import numpy as np

from benchmarks.planner.setups import turbulent_setup
from locate.simulation.plume_field import visible_percentile

SETUPS = 30


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--setups", type=int, default=SETUPS)


def main(options: argparse.Namespace) -> None:
    print("gas | planned px | frames over planned (least, most) | their mean over planned")
    of_frames, of_mean = [], []
    for number in range(options.first, options.first + options.setups):
        setup = turbulent_setup(number)
        shown = setup.displacements()
        planned_px = setup.plan.strength_px
        frames = np.array([visible_percentile(frame) for frame in shown]) / planned_px
        of_frames.append(float(frames.mean()))
        of_mean.append(visible_percentile(shown.mean(axis=0)) / planned_px)
        print(
            f"{setup.plan.source.gas} | {planned_px:.4f} | {frames.mean():.2f} "
            f"({frames.min():.2f}, {frames.max():.2f}) | {of_mean[-1]:.2f}",
            flush=True,
        )
    for name, ratios in (("frames", of_frames), ("mean", of_mean)):
        print(f"{name}: {min(ratios):.2f} to {max(ratios):.2f}, median {np.median(ratios):.2f}")
