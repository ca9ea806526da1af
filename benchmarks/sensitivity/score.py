"""Scores what every detector makes of what was measured.

    python -m benchmarks.sensitivity score --quick [--json scores.json] [--plot scores.png]

Can be repeated when weights change.
"""

import argparse
import json
from collections import defaultdict
from pathlib import Path

from benchmarks.common.filmed import Recorded
from benchmarks.sensitivity.conditions import (
    add_case_arguments,
    axes,
    scale_of,
    scene_of,
    sequences,
    take_of,
)
from benchmarks.sensitivity.contenders import ComparedDetectors
from benchmarks.sensitivity.measures import evaluate
from benchmarks.sensitivity.picture import plot
from benchmarks.sensitivity.summary import label_of, summarise, table
from geometry.image_files import write_image


def add_arguments(parser: argparse.ArgumentParser) -> None:
    add_case_arguments(parser)
    parser.add_argument("--weights", type=Path, help="of the learned detector")
    parser.add_argument("--fuse", nargs="*", default=list(axes(True)), help="axes with sources")
    parser.add_argument("--json", type=Path)
    parser.add_argument("--plot", type=Path)


def main(options: argparse.Namespace) -> None:
    scale = scale_of(options)
    contenders = ComparedDetectors(options.weights)
    found: defaultdict[str, list[dict[str, dict[str, float]]]] = defaultdict(list)
    for axis, condition, seed in sequences(scale):
        path = options.work / f"{condition.sequence(seed)}.npz"
        if not path.exists():
            continue
        take = take_of(condition, scene_of(condition, seed, scale), options.photos)
        sequence = Recorded.load(path, take)
        label = f"{axis} {label_of(axis, condition)}"
        found[label].append(evaluate(sequence, condition, contenders, fusing=axis in options.fuse))
        print(label, seed, json.dumps(found[label][-1]), flush=True)
    summary = {label: summarise(results) for label, results in found.items()}
    if options.json:
        options.json.write_text(json.dumps(summary, indent=1))
    print(table(summary))
    if options.plot:
        write_image(options.plot, plot(summary))
