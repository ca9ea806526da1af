"""Writes what a run would state of each recording.

Keeps what is present in the work folder: delete `*.json` there when the method has changed.
"""

import argparse

from benchmarks.common.filmed import Recorded
from benchmarks.reliability.answers import evaluate_recording
from benchmarks.reliability.recordings import (
    add_recording_arguments,
    chosen,
    flow_of,
    flowing,
    scene_of,
)
from detect.kinds import REGISTERED
from detect.registered import RegisteredDetector
from locate.simulation.capture import CaptureSetup
from locate.simulation.layouts import random_scene


def add_arguments(parser: argparse.ArgumentParser) -> None:
    add_recording_arguments(parser)


def main(options: argparse.Namespace) -> None:
    detector = RegisteredDetector(weights=REGISTERED.find_weights())
    for seed in chosen(options):
        recorded, path = (options.work / f"{seed}.{suffix}" for suffix in ("npz", "json"))
        if recorded.exists() and not path.exists():
            leak = flowing(random_scene(seed, plume=True).plumes[0], flow_of(seed))
            evaluate_recording(
                Recorded.load(recorded, CaptureSetup(scene=scene_of(seed))), leak, detector
            ).save(path)
            print(seed, path.read_text(), flush=True)
