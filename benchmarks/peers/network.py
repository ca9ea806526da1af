"""The network of `registered` by several runtimes: CPU seconds for a frame of 640 x 480.

    OMP_NUM_THREADS=1 python -m benchmarks.peers network [--out DIR]

Writes peers_network.csv. The architecture is that of the shipped network, the weights are random:
every runtime computes the same sums. One thread each; what torch.compile costs at its first call is
not counted, but printed.
"""

import argparse
import tempfile
from collections.abc import Callable
from functools import partial
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
import torch

from benchmarks.common.cost import cpu_seconds
from benchmarks.common.csv_tables import DOCS, write_table
from benchmarks.common.turns import time_in_turn
from detect.learning.export import save_network
from detect.learning.networks import PlumeNet
from detect.network import Network
from detect.registered.features import FEATURES
from geometry.arrays import FloatMap

SIZE = (480, 640)
OUTPUT = "logit"
Runtime = Callable[[FloatMap], FloatMap]


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--out", type=Path, default=DOCS)


def main(options: argparse.Namespace) -> None:
    torch.set_num_threads(1)
    torch.manual_seed(0)
    channels = len(FEATURES)
    planes = np.random.default_rng(0).normal(size=(channels, *SIZE)).astype(np.float32)
    network = PlumeNet(channels=channels, normalise=False).eval()
    torch.nn.init.normal_(network.head.weight)
    with tempfile.TemporaryDirectory() as folder:
        path = save_network(network, Path(folder) / "network.onnx", "random", channels, {})
        runtimes = {"ours: onnxruntime": by_onnxruntime(path)}
        runtimes |= {"torch, eager": by_torch(network)}
        runtimes |= {"torch.compile": by_torch(torch.compile(network))}
        if find_spec("openvino") is None:
            print("OpenVINO is left out: it is not installed")
        else:
            runtimes["OpenVINO, float32"] = by_openvino(path, INFERENCE_PRECISION_HINT="f32")
            runtimes["OpenVINO, defaults"] = by_openvino(path)
        first_s = cpu_seconds(lambda: runtimes["torch.compile"](planes)).item()
        print(f"torch.compile: {first_s:.0f} CPU s at the first call")
        answers = {name: runtime(planes) for name, runtime in runtimes.items()}
        costs = time_in_turn({name: partial(run, planes) for name, run in runtimes.items()})
    exact = answers["torch, eager"]
    scale = float(np.abs(exact).max())
    rows = [
        {
            "runtime": name,
            "largest difference from torch, share of the largest score": (
                f"{np.abs(answers[name] - exact).max() / scale:.0e}"
            ),
            "CPU ms": f"{1000 * cost.cpu_s:.0f}",
            "CPU, of ours": f"{cost.of_first:.2f}",
        }
        for name, cost in costs.items()
    ]
    write_table(options.out / "peers_network.csv", rows)


def by_onnxruntime(path: Path) -> Runtime:
    network = Network(path)
    return lambda planes: network(planes)[OUTPUT]


def by_torch(network: Any) -> Runtime:
    def run(planes: FloatMap) -> FloatMap:
        with torch.inference_mode():
            return np.asarray(network(torch.from_numpy(planes[None])).logit[0])

    return run


def by_openvino(path: Path, **settings: str) -> Runtime:
    import openvino

    compiled = openvino.Core().compile_model(
        path, "CPU", {"INFERENCE_NUM_THREADS": "1", "PERFORMANCE_HINT": "LATENCY", **settings}
    )
    return lambda planes: np.asarray(compiled({"image": planes[None]})[OUTPUT][0])
