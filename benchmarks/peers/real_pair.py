"""Displacement of a real pair: our flow methods beside others.

    OMP_NUM_THREADS=1 python -m benchmarks.peers real-pair [DATA_DIR] [--out DIR]

Writes peers_real_pair.csv: part of the blowtorch against the PIV field of its authors, as
`benchmarks.flow pairs` has it: one side of the plume, and still air. That field is no truth: it is
a cross-correlation of windows of 16 px.
"""

import argparse
from pathlib import Path

import numpy as np

from benchmarks.common.csv_tables import DOCS, Row, write_table
from benchmarks.flow.pairs import BLOWTORCH, DEFAULT_DATA, STEP_PX, piv_agreement, read_piv
from benchmarks.peers.other_flows import installed_flows
from detect.bos import texture_of, unbiased_flow
from locate.recording.images import read_grey

CUT = (slice(50, 100), slice(0, 100))
"""Of the PIV windows, rows and columns."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("data", type=Path, nargs="?", default=DEFAULT_DATA)
    parser.add_argument("--out", type=Path, default=DOCS)


def main(options: argparse.Namespace) -> None:
    folder = options.data / "1_bos_pairs" / BLOWTORCH[0]
    pixels = tuple(slice(STEP_PX * cut.start, STEP_PX * (cut.stop + 1)) for cut in CUT)
    reference, image = (
        np.ascontiguousarray(read_grey(folder / name)[pixels]) for name in BLOWTORCH[1:]
    )
    texture = texture_of(reference)
    rows = []
    for name, flow in installed_flows().items():
        w, _ = unbiased_flow(flow, reference, image, texture)
        row: Row = {"flow": name}
        for axis, (component, piv) in enumerate(zip("uv", read_piv(folder), strict=True)):
            r, difference_px, slope = piv_agreement(w, piv[CUT], axis)
            row |= {
                f"correlation, {component}": f"{r:.3f}",
                f"median difference, px, {component}": f"{difference_px:.3f}",
                f"slope, {component}": f"{slope:.2f}",
            }
        rows.append(row)
    write_table(options.out / "peers_real_pair.csv", rows)
