"""Straight columns of hot air and gases: the planned strength over the simulated one.

    python -m benchmarks.planner straight

Prints the strength without a window of measurement, over the 95th percentile of the displacement of
the rays that the simulator bends.
"""

import argparse

from benchmarks.planner.setups import straight_setup
from locate.simulation.plume_field import visible_percentile

SETUPS = 30


def ratio_to_simulated(number: int) -> float:
    """The planned strength of a set-up over that of the simulated one."""
    setup = straight_setup(number)
    return setup.plan.strength_px / visible_percentile(setup.displacements()[0])


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--setups", type=int, default=SETUPS)


def main(options: argparse.Namespace) -> None:
    ratios = []
    for number in range(options.setups):
        ratios.append(ratio_to_simulated(number))
        print(f"{number:2} planned over simulated {ratios[-1]:.3f}", flush=True)
    print(f"{min(ratios):.3f} to {max(ratios):.3f}")
