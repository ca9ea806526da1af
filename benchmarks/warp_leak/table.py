"""Trains a network each way, and tests both on both ways.

    OMP_NUM_THREADS=1 python -m benchmarks.warp_leak table [--network lite] --photos PHOTOS -o DIR

Prints AUROC by what a network was trained and tested on, and its mean score by how an image moved.
"""

import argparse
from dataclasses import replace
from pathlib import Path

import numpy as np

from benchmarks.warp_leak.networks import PLUME_PX, STILL_PX, UNETS, Ask, perceptron, unet
from benchmarks.warp_leak.twins import WAYS, held_out, noisy, shifted
from detect.scores import auroc
from detect.synthesis import shards_in
from geometry.arrays import FloatMap

MAN_MADE = [
    "2208891", "2599868", "3623285", "pexels-photo-1029599", "pexels-photo-951408", "164338",
    "1963557", "271619", "271624", "86127fbdb368", "kodim08",
]  # fmt: skip
NATURAL = [
    "2581922", "2600340", "3044702", "5894435", "2666598", "3584430", "7233401", "kodim14",
    "kodim18",
]  # fmt: skip
"""Of the held-out photos, sorted by eye; the others show people, things and drawings."""
SHIFTS_PX = (0.0, 0.125, 0.25, 0.5)
STRONG_PX = 0.25
Groups = dict[str, np.ndarray]


def score_answers(score: FloatMap, said: FloatMap, sizes: FloatMap, groups: Groups) -> list[str]:
    """AUROC by group of photos, and the correlation of the sizes; of (N, H, W) samples."""
    asked = (sizes > PLUME_PX) | (sizes < STILL_PX)
    cells = [
        auroc(score[rows][asked[rows]], sizes[rows][asked[rows]] > PLUME_PX)
        for rows in groups.values()
    ]
    strong = sizes > STRONG_PX
    asked = strong | (sizes < STILL_PX)
    cells.append(auroc(score[asked], strong[asked]))
    return [
        *(f"{cell:.3f}" for cell in cells),
        f"{np.corrcoef(said.ravel(), sizes.ravel())[0, 1]:.2f}",
    ]


def train_network(options: argparse.Namespace, folder: Path) -> Ask:
    if options.network == "perceptron":
        return perceptron(folder)
    return unet(options.network, folder, options.steps)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--photos", type=Path, required=True)
    parser.add_argument("--network", choices=["perceptron", *UNETS], default="perceptron")
    parser.add_argument("--steps", type=int, default=2200)
    parser.add_argument("-o", type=Path, required=True)


def main(options: argparse.Namespace) -> None:
    paths = held_out(options.photos)
    asks = {way: train_network(options, options.o / f"train-{way}") for way in WAYS}
    sets = {
        way: [
            s
            for shard in shards_in(options.o / f"test-{way}")
            for s in map(shard.sample_at, range(len(shard)))
        ]
        for way in WAYS
    }
    sets["bilinear, then noise"] = [
        replace(sample, image=noisy(sample.image, i)) for i, sample in enumerate(sets["bilinear"])
    ]
    of = np.array([paths[i % len(paths)].stem for i in range(len(sets["camera"]))])
    groups = {"man-made": np.isin(of, MAN_MADE), "natural": np.isin(of, NATURAL)}
    groups["all"] = np.ones(len(of), dtype=bool)
    print("| trained on | tested on | AUROC man-made | natural | all photos | all, above "
          f"{STRONG_PX} px | r of sizes |\n|" + "---|" * 7)  # fmt: skip
    sizes = np.array([np.linalg.norm(s.displacement, axis=-1) for s in sets["camera"]])
    for tested, samples in sets.items():
        for trained, ask in asks.items():
            answers = [ask(sample.image) for sample in samples]
            score, said = (np.array(maps) for maps in zip(*answers, strict=True))
            cells = score_answers(score, said, sizes, groups)
            print(f"| {trained} | {tested} | {' | '.join(cells)} |", flush=True)
    print("\n| moved by | trained on | "
          + " | ".join(f"{s} px" for s in SHIFTS_PX) + " |\n|" + "---|" * 6)  # fmt: skip
    moved = [[shifted(path, i, px) for i, path in enumerate(paths)] for px in SHIFTS_PX]
    for way in WAYS:
        for trained, ask in asks.items():
            means = [np.mean([ask(images[way])[0].mean() for images in row]) for row in moved]
            print(f"| {way} | {trained} | {' | '.join(f'{m:.3f}' for m in means)} |", flush=True)
