"""Writes what a run would state of each recording.

    python -m benchmarks.reliability score --work work/stated [--flows K...]

Prints the seed and the outcome of each. Keeps what is present in the work folder: delete `*.json`
there when the method has changed.
"""

import argparse

from benchmarks.common.filmed import Recorded
from benchmarks.reliability.answers import evaluate_recording
from benchmarks.reliability.recordings import add_recording_arguments, capture_of, chosen
from detect.kinds import REGISTERED
from detect.registered import RegisteredDetector


def add_arguments(parser: argparse.ArgumentParser) -> None:
    add_recording_arguments(parser)


def main(options: argparse.Namespace) -> None:
    detector = RegisteredDetector(weights=REGISTERED.find_weights())
    for seed in chosen(options):
        recorded, path = (options.work / f"{seed}.{suffix}" for suffix in ("npz", "json"))
        if recorded.exists() and not path.exists():
            sequence = Recorded.load(recorded, capture_of(seed, options.photos))
            evaluate_recording(seed, sequence, detector).save(path)
            print(seed, path.read_text(), flush=True)
