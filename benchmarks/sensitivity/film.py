"""Renders each sequence and measures its key frames.

    OMP_NUM_THREADS=1 python -m benchmarks.sensitivity film --quick --photos PHOTOS

What is present in the work folder is kept, so a stopped run goes on where it stopped; `--part K N`
does every Nth sequence.
"""

import argparse

from benchmarks.common.filmed import record
from benchmarks.sensitivity.conditions import (
    add_case_arguments,
    scale_of,
    scene_of,
    sequences,
    take_of,
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    add_case_arguments(parser)
    parser.add_argument("--part", type=int, nargs=2, default=(0, 1), metavar=("K", "N"))


def main(options: argparse.Namespace) -> None:
    scale = scale_of(options)
    wanted = {c.sequence(seed): (c, seed) for _, c, seed in sequences(scale)}
    options.work.mkdir(parents=True, exist_ok=True)
    first, every = options.part
    for name, (condition, seed) in list(wanted.items())[first::every]:
        path = options.work / f"{name}.npz"
        if not path.exists():
            take = take_of(condition, scene_of(condition, seed, scale), options.photos)
            record(take, scale.keys, path)
            print(name, flush=True)
