"""CPU time of the network, and of a key frame of a finished run.

    OMP_NUM_THREADS=1 python -m benchmarks.registered speed NETWORK.onnx [--run RUN]

Prints the least and the median CPU ms of each.
"""

import argparse
from collections.abc import Callable
from pathlib import Path

import numpy as np

from benchmarks.common.cost import cpu_seconds
from benchmarks.scenes.limit import load_posed_frames
from detect.registered.detector import RegisteredDetector, displacement_sigma
from detect.registered.evidence_network import EvidenceNetwork
from detect.registered.features import FEATURES, stack_features
from locate.pipeline.points import load_points
from locate.recording.spacing import spread_key_rows

KEY_FRAMES = 16


def print_cost(name: str, work: Callable[[], object], times: int) -> None:
    spent_ms = 1000 * cpu_seconds(work, times)
    print(f"{name}: {spent_ms.min():.1f} ms of CPU at best, median {np.median(spent_ms):.1f}")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("network", type=Path)
    parser.add_argument("--run", type=Path)


def main(options: argparse.Namespace) -> None:
    network = EvidenceNetwork(options.network)
    inputs = np.random.default_rng(0).normal(size=(len(FEATURES), 480, 640)).astype(np.float32)
    print_cost("network at 640 x 480", lambda: network.network(inputs), 20)
    print_cost("with what is made of it", lambda: network.evaluate(inputs), 20)
    if options.run is None:
        return
    frames = load_posed_frames(options.run, options.run / "frames").undistorted()
    points = load_points(options.run / "points.npz")
    detector = RegisteredDetector(points_in_world=points, weights=options.network)
    rows = iter([*spread_key_rows(len(frames), KEY_FRAMES, ends=3).tolist()] * 2)

    def measured() -> None:
        found = detector.measure(frames, next(rows))
        assert found is not None
        stack_features(found[0], displacement_sigma(found[0]))

    print_cost("a key frame's measurement and features", measured, KEY_FRAMES)
    print_cost("a key frame in all", lambda: detector.detect(frames, next(rows)), KEY_FRAMES)
