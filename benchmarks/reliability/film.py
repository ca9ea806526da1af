"""Renders the recordings and measures their key frames; keeps what the work folder holds.

    python -m benchmarks.reliability film --work work/stated [--flows K...]

Prints the seed of each recording that is done.
"""

import argparse

from benchmarks.common.filmed import record
from benchmarks.reliability.recordings import KEYS, add_recording_arguments, capture_of, chosen


def add_arguments(parser: argparse.ArgumentParser) -> None:
    add_recording_arguments(parser)


def main(options: argparse.Namespace) -> None:
    options.work.mkdir(parents=True, exist_ok=True)
    for seed in chosen(options):
        path = options.work / f"{seed}.npz"
        if not path.exists():
            record(capture_of(seed, options.photos), KEYS, path)
            print(seed, flush=True)
