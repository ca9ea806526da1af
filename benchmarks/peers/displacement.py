"""Displacement before a known background: our flow methods beside others.

    OMP_NUM_THREADS=1 python -m benchmarks.peers displacement [--pairs N] [--out DIR]

Writes peers_displacement.csv: simulated pairs, with truth, as `benchmarks.flow simulated` has them.
OpenCV's methods run with the settings of `detect/flow.py`, the others with their defaults.
"""

import argparse
from collections.abc import Mapping
from functools import partial
from pathlib import Path

from benchmarks.common.csv_tables import DOCS, Row, write_table
from benchmarks.common.turns import TurnCost, time_in_turn
from benchmarks.flow.simulated import KINDS, Pair, score_flow, simulate_pairs
from benchmarks.peers.other_flows import installed_flows
from detect.flow import Flow

NOISE = 1.0


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--pairs", type=int, default=2, help="per background and peak")
    parser.add_argument("--out", type=Path, default=DOCS)


def main(options: argparse.Namespace) -> None:
    flows = installed_flows()
    simulated = {
        kind: list(simulate_pairs(kind, options.pairs, NOISE, (), seed=0)) for kind in KINDS
    }
    timed = simulated["perlin"][0]
    costs = time_in_turn(
        {name: partial(flow, timed.reference, timed.image) for name, flow in flows.items()}
    )
    rows = []
    for name, flow in flows.items():
        rows.append(simulated_row(name, flow, simulated, costs[name]))
        print(rows[-1], flush=True)
    write_table(options.out / "peers_displacement.csv", rows)


def simulated_row(
    name: str, flow: Flow, simulated: Mapping[str, list[Pair]], cost: TurnCost
) -> Row:
    scores = [score_flow(flow, pairs) for pairs in simulated.values()]
    error, gain, noise, found = (
        " / ".join(one)
        for one in zip(
            *((f"{s.epe_px:.3f}", f"{s.gain:.2f}", f"{s.noise_px:.3f}", s.found_from)
              for s in scores),
            strict=True,
        )
    )  # fmt: skip
    return {
        "flow": name,
        "error in the plume, px: sinusoid / Perlin / squares": error,
        "gain": gain,
        "noise, px": noise,
        "found from, px": found,
        "CPU ms": f"{1000 * cost.cpu_s:.0f}",
        "CPU, of ours": f"{cost.of_first:.2f}",
    }
