"""Fields and crops per CPU second of the synthesis, one thread.

    OMP_NUM_THREADS=1 python -m benchmarks.cost synthesis [--photos DIR] [--flows DIR | --runs 5]

Flows are simulated into a temporary folder unless there is one. A crop is 128 x 128 px.
"""

import argparse
import platform
import tempfile
import time
from functools import partial
from pathlib import Path

import numpy as np

from benchmarks.common.cost import cpu_seconds
from detect.synthesis import FAMILIES, Recipe, Sources, sample_at
from detect.synthesis.flows import RUN_KINDS, random_turbulence, read_run, write_run

CROPS = 30


def print_row(name: str, seconds: float, count: int) -> None:
    print(f"| {name} | {1000 * seconds / count:.1f} | {count / seconds:.1f} |", flush=True)


def time_flows(folder: Path, runs: int) -> None:
    for number in range(runs):
        seconds = cpu_seconds(partial(write_run, folder, number)).item()
        fields = len(read_run(folder / f"run_{number:05d}.npz"))
        print_row(
            f"field, {RUN_KINDS[number % len(RUN_KINDS)]} ({seconds:.0f} s a run)", seconds, fields
        )
    rng = np.random.default_rng(0)
    seconds = cpu_seconds(lambda: [random_turbulence(rng) for _ in range(CROPS)]).item()
    print_row("field, random turbulence", seconds, CROPS)


def time_crops(recipe: Recipe) -> tuple[float, float]:
    """CPU seconds of CROPS samples, and the share of their pixels that is plume."""
    sources = Sources.from_recipe(recipe)
    sample_at(CROPS, recipe, sources)
    start = time.process_time()
    samples = [sample_at(index, recipe, sources) for index in range(CROPS)]
    seconds = time.process_time() - start
    return seconds, float(np.mean([sample.mask.mean() for sample in samples]))


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--photos", type=Path)
    parser.add_argument("--flows", type=Path)
    parser.add_argument("--runs", type=int, default=1)


def main(options: argparse.Namespace) -> None:
    print(f"{platform.machine()}, Python {platform.python_version()}, one thread\n")
    print("| what | CPU ms each | per CPU s |\n|---|---|---|")
    with tempfile.TemporaryDirectory() as scratch:
        flows = options.flows or Path(scratch)
        if options.flows is None:
            time_flows(flows, options.runs)
        covered = []
        for family in FAMILIES:
            if family == "photo" and options.photos is None:
                continue
            recipe = Recipe(families={family: 1}, photos=options.photos, flows=flows, negatives=0)
            seconds, share = time_crops(recipe)
            covered.append(share)
            print_row(f"crop, {family}", seconds, CROPS)
        print(f"\nPlume covers {100 * np.mean(covered):.0f} % of the pixels of positives.")
