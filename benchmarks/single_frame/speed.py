"""CPU time of the single-frame detector and its parts, one thread, images of 640 x 480 px.

    OMP_NUM_THREADS=1 python -m benchmarks.single_frame speed --networks A.onnx [--photos PHOTOS]

Prints the median and the least CPU ms of each network and part; `--paper` adds the paper's network.
"""

import argparse
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path

import cv2
import numpy as np

from benchmarks.common.cost import cpu_seconds
from benchmarks.single_frame.contenders import planes
from benchmarks.single_frame.photos import detected, photo
from detect.dybs import DybsDetector
from detect.dybs.demodulation import demodulate_lattice
from detect.dybs.edges import measure_edges
from detect.dybs.pattern_measurement import measure_pattern
from detect.dybs.refinement import RefinementNetwork
from detect.network import Network
from detect.synthesis.raster import find_photos
from detect.texture import texture_classes
from geometry.arrays import GreyImage

SHAPE = (480, 640)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--networks", nargs="+", type=Path, required=True)
    parser.add_argument("--photos", type=Path)
    parser.add_argument("--paper", action="store_true")


def main(options: argparse.Namespace) -> None:
    image = np.random.default_rng(0).integers(0, 256, SHAPE, dtype=np.uint8)
    y, x = np.mgrid[: SHAPE[0], : SHAPE[1]]
    checks = 120 + 60 * np.sin(0.7 * x + 0.1 * y) * np.sin(0.7 * y - 0.1 * x)
    lattice = (checks + image / 100).astype(np.uint8)
    whole = {"on noise": image, "all a lattice": lattice}
    for path in find_photos(options.photos, "test")[:1] if options.photos else []:
        size = SHAPE[::-1]
        whole["on a photo"] = cv2.resize(photo(path), size, interpolation=cv2.INTER_AREA)
    print("| what, 640 x 480, one thread | CPU ms, median | fastest |\n|---|---|---|")
    for path in options.networks:
        time_network(path, image, whole)
    print_cost("texture classes", lambda: texture_classes(image))
    print_cost(
        "demodulation, all a lattice", lambda: demodulate_lattice(lattice, np.ones(SHAPE, bool))
    )
    for name, seen in whole.items():
        if seen is not lattice:
            print_cost(f"edges, {name}", partial(measure_edges, seen))
    measured, refine = measure_pattern(lattice, texture_classes(lattice)), RefinementNetwork()
    print_cost("refinement, onnxruntime", lambda: refine(measured, SHAPE))
    if options.paper:
        time_paper(image)


def time_network(path: Path, image: GreyImage, whole: Mapping[str, GreyImage]) -> None:
    """One of ours, and the detector with it on every image."""
    network, detector = Network(path), DybsDetector(path)
    print_cost(f"{network.name}, onnxruntime", lambda: network(planes(image)))
    for name, seen in whole.items():
        print_cost(f"dybs with it, {name}", partial(detected, detector, seen))


def time_paper(image: GreyImage) -> None:
    """The paper's network with random weights, 64 channels wide."""
    import tempfile

    import torch

    from detect.learning.export import save_network
    from detect.learning.networks import PaperUNet

    torch.set_num_threads(1)
    network = PaperUNet().eval()
    with tempfile.TemporaryDirectory() as scratch, torch.inference_mode():
        tensor = torch.from_numpy(planes(image)[None])
        print_cost("the paper's network, torch", lambda: network(tensor), times=3)
        path = save_network(network, Path(scratch) / "paper.onnx", "paper", 1, {})
        exported = Network(path)
        print_cost("the paper's network, onnxruntime", lambda: exported(planes(image)), times=3)


def print_cost(name: str, work: Callable[[], object], times: int = 15) -> None:
    work()
    spent_ms = 1000 * cpu_seconds(work, times)
    print(f"| {name} | {np.median(spent_ms):.0f} | {spent_ms.min():.0f} |", flush=True)
