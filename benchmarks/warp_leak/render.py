"""Makes the samples, both ways.

    python -m benchmarks.warp_leak render --photos PHOTOS --runs RUNS -o DIR

Prints nothing: the samples are in DIR/train and DIR/test.
"""

import argparse
from pathlib import Path

from benchmarks.warp_leak.twins import CROPS, held_out, write
from detect.synthesis.flows import runs_in
from detect.synthesis.raster import find_photos


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--photos", type=Path, required=True)
    parser.add_argument("--runs", type=Path, required=True)
    parser.add_argument("--samples", type=int, default=4096)
    parser.add_argument("-o", type=Path, required=True)


def main(options: argparse.Namespace) -> None:
    known = find_photos(options.photos, "train")
    write(options.o / "train", known, runs_in(options.runs, "train"), options.samples, seed=0)
    unseen = held_out(options.photos)
    write(options.o / "test", unseen, runs_in(options.runs, "test"), CROPS * len(unseen), seed=1)
