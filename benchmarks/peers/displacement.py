"""Displacement before a known background: our flow methods beside others.

    OMP_NUM_THREADS=1 python -m benchmarks.peers displacement [DATA_DIR] [--pairs N] [--out DIR]

Writes peers_displacement.csv (simulated pairs, with truth, as `benchmarks.flow simulated` has
them) and peers_real_pair.csv (part of the blowtorch against the PIV field of its authors, as
`benchmarks.flow pairs` has it). OpenCV's methods run with the settings of `detect/flow.py`, the
others with their defaults.
"""

import argparse
from collections.abc import Mapping
from functools import partial
from pathlib import Path

from benchmarks.common.csv_tables import DOCS, Row, write_table
from benchmarks.common.turns import TurnCost, time_in_turn
from benchmarks.flow.pairs import BLOWTORCH, DEFAULT_DATA, STEP_PX, piv_agreement, read_piv
from benchmarks.flow.simulated import KINDS, Pair, score_flow, simulate_pairs
from benchmarks.peers.other_flows import installed_flows
from detect.bos import texture_of, unbiased_flow
from detect.flow import Flow
from locate.recording.images import read_grey

NOISE = 1.0
CUT = (slice(37, 115), slice(0, 118))
"""Of the blowtorch's PIV windows, rows and columns: one side of the plume, and still air."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("data", type=Path, nargs="?", default=DEFAULT_DATA)
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
    rows = [simulated_row(name, flow, simulated, costs[name]) for name, flow in flows.items()]
    write_table(options.out / "peers_displacement.csv", rows)
    write_table(options.out / "peers_real_pair.csv", real_rows(options.data, flows))


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


def real_rows(data: Path, flows: Mapping[str, Flow]) -> list[Row]:
    """Every method on the blowtorch."""
    folder = data / "1_bos_pairs" / BLOWTORCH[0]
    pixels = tuple(slice(STEP_PX * cut.start, STEP_PX * (cut.stop + 1)) for cut in CUT)
    reference, image = (read_grey(folder / name)[pixels] for name in BLOWTORCH[1:])
    texture = texture_of(reference)
    rows = []
    for name, flow in flows.items():
        w, _ = unbiased_flow(flow, reference, image, texture)
        row = {"flow": name}
        for axis, (component, piv) in enumerate(zip("uv", read_piv(folder), strict=True)):
            r, difference_px, slope = piv_agreement(w, piv[CUT], axis)
            row |= {
                f"correlation, {component}": f"{r:.3f}",
                f"median difference, px, {component}": f"{difference_px:.3f}",
                f"slope, {component}": f"{slope:.2f}",
            }
        rows.append(row)
    return rows
