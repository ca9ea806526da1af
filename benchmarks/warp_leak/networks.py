"""The leak: a network trained on software warps reads their blur, and nothing else.

    OMP_NUM_THREADS=1 python benchmarks/leak.py render --photos PHOTOS --runs RUNS -o DIR
    ... table --network perceptron|lite|paper [--steps 2200] --photos PHOTOS -o DIR

Every sample is made twice of one part of a photo and one plume. `camera`: seen through the plume as
a camera sees it. `bilinear`: taken without the plume, then warped by software, as the paper does.
The cameras of the two (shift by part of a pixel, blur, noise) are drawn alike, not equal.
Training samples come from the photos and runs of the training split, test samples from the photos
of the validation and the test split (nothing is chosen on either) and the runs of the test split.

One network is trained each way, with equal samples and steps; both are judged on both, and on
bilinear warps with noise added after them. Each answers the same: whether a pixel is displaced, and
by how much. The perceptron is as small as can read blur: fixed differences of neighbours at two
scales, their energies in two windows, and two hidden layers on their logarithms; it learns in
seconds. `lite` is the design of the shipped network at its width of 16; `paper` that of the paper,
8 channels wide at full resolution (64 take sixteen times as long); its two channels answer the two
questions. UNets see first samples that are moved by 0.4 px and more, or not at all, and then all.

Pixels as in detectors.py: positive where |w| > 0.06 px, negative where |w| < 0.02 px.
"""

import argparse
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import torch
from torch import Tensor, nn
from torch.nn import functional

from detect.learning.networks import PaperUNet, PlumeNet, Prediction
from detect.scores import auroc
from detect.synthesis import FAMILIES, Recipe, Sample, Shard, Sources, shards_in
from detect.synthesis.camera import MARGIN_PX, Optics, expose, naive_warp
from detect.synthesis.dataset import SCHEMA, SHARD_SAMPLES, write_index
from detect.synthesis.flows import runs_in
from detect.synthesis.raster import as_background, canvas_side, photo, photos_in
from detect.synthesis.sample import seen_through_plume
from geometry.arrays import FloatMap, GreyImage

WAYS = ("bilinear", "camera")
MAN_MADE = [
    "2208891", "2599868", "3623285", "pexels-photo-1029599", "pexels-photo-951408", "164338",
    "1963557", "271619", "271624", "86127fbdb368", "kodim08",
]  # fmt: skip
NATURAL = [
    "2581922", "2600340", "3044702", "5894435", "2666598", "3584430", "7233401", "kodim14",
    "kodim18",
]  # fmt: skip
"""Of the held-out photos, sorted by eye; the others show people, things and drawings."""
SIZE_PX, CROPS = 96, 16
NOISE_AFTER = 2.0
SHIFTS_PX = (0.0, 0.125, 0.25, 0.5)
STRONG_PX = 0.25

PLUME_PX, STILL_PX, UNIT_PX = 0.06, 0.02, 0.1
THIN = (slice(3, None, 6),) * 2
SCALES_PX, WINDOWS_PX, FLOOR = (0.0, 0.8), (2.5, 7.0), 0.05
DIFFERENCES = [
    np.array(rows, np.float32)
    for rows in (
        [[1, -2, 1]], [[1], [-2], [1]], [[1, -1], [-1, 1]], [[1, -1]], [[1], [-1]],
        [[1, 0, 0], [0, -2, 0], [0, 0, 1]],
    )
]  # fmt: skip
HIDDEN, RATE, STEPS, BATCH = 48, 3e-3, 3000, 2048
UNETS: dict[str, Callable[[], nn.Module]] = {
    "lite": lambda: PlumeNet(width=16),
    "paper": lambda: PaperUNet(width=8),
}
UNET_RATE, UNET_BATCH, WARM_UP = 2e-3, 16, 100
CLEAR_PX, CLEAR_SHARE = 0.4, 0.4
SIZE_WEIGHT = 0.1

Ask = Callable[[GreyImage], tuple[FloatMap, FloatMap]]
"""Of an image: probability and size (px) of displacement, (H, W) each."""
Groups = dict[str, np.ndarray]


def held_out(photos: Path) -> list[Path]:
    return [*photos_in(photos, "validation"), *photos_in(photos, "test")]


def twins(rng: np.random.Generator, path: Path, runs: tuple[Path, ...]) -> dict[str, Sample]:
    """One part of a photo through one plume, or none, both ways."""
    recipe = Recipe(
        size_px=SIZE_PX, families={"photo": 1}, photos=path, exposures=1, gamma=(1, 1), jpeg_share=0
    )
    background = as_background(photo(rng, canvas_side(SIZE_PX), path))
    seed, still = rng.integers(2**32), recipe.model_copy(update={"negatives": 1.0})
    view, without = (
        seen_through_plume(
            background, "photo", np.random.default_rng(seed), each, Sources(runs=runs)
        )
        for each in (recipe, still)
    )
    warped = naive_warp(without.image, view.displacement)
    return {"camera": view, "bilinear": replace(view, image=warped)}


def write(
    folder: Path, paths: Sequence[Path], runs: tuple[Path, ...], count: int, *, seed: int
) -> None:
    """FOLDER-bilinear and FOLDER-camera: sample i is of photo i % len(paths)."""
    for first in range(0, count, SHARD_SAMPLES):
        targets = {way: Path(f"{folder}-{way}") / f"shard_{first:06d}.npz" for way in WAYS}
        if all(path.exists() for path in targets.values()):
            continue
        pairs = [
            twins(np.random.default_rng([seed, i]), paths[i % len(paths)], runs)
            for i in range(first, min(first + SHARD_SAMPLES, count))
        ]
        for way, path in targets.items():
            write_index(path.parent, {"schema": SCHEMA, "families": list(FAMILIES)})
            Shard.of([pair[way] for pair in pairs]).save(path)
        print(f"{folder.name}: {first + len(pairs)} of {count}", flush=True)


def render(options: argparse.Namespace) -> None:
    known = photos_in(options.photos, "train")
    write(options.o / "train", known, runs_in(options.runs, "train"), options.samples, seed=0)
    unseen = held_out(options.photos)
    write(options.o / "test", unseen, runs_in(options.runs, "test"), CROPS * len(unseen), seed=1)


def energies(image: GreyImage) -> FloatMap:
    """(H, W, F) logarithms of the energy of differences, by direction, scale and window."""
    planes, grey = [], image.astype(np.float32)
    for scale in SCALES_PX:
        smooth = cv2.GaussianBlur(grey, (0, 0), scale) if scale else grey
        for kernel in DIFFERENCES:
            energy = cv2.filter2D(smooth, cv2.CV_32F, kernel) ** 2
            planes += [cv2.GaussianBlur(energy, (0, 0), window) for window in WINDOWS_PX]
    return np.log(np.stack(planes, axis=-1) + FLOOR)


def samples(folder: Path) -> tuple[GreyImage, FloatMap]:
    """(N, H, W) images of a folder and |w| in them, px."""
    shards = list(shards_in(folder))
    sizes = [np.linalg.norm(s.displacements.astype(np.float32), axis=-1) for s in shards]
    images = np.concatenate([shard.images for shard in shards])
    return images.reshape(images.shape[:3]), np.concatenate(sizes)


def loss_of(logit: Tensor, size: Tensor, size_px: Tensor, size_weight: float) -> Tensor:
    asked = (size_px > PLUME_PX) | (size_px < STILL_PX)
    plume = (size_px[asked] > PLUME_PX).float()
    mask = functional.binary_cross_entropy_with_logits(logit[asked], plume)
    return mask + size_weight * functional.mse_loss(size, size_px / UNIT_PX)


def perceptron(folder: Path) -> Ask:
    """Trained on the samples of a folder."""
    torch.manual_seed(0)
    images, sizes_px = samples(folder)
    inputs = torch.from_numpy(np.array([energies(image)[THIN] for image in images]))
    inputs, size_px = inputs.flatten(0, 2), torch.from_numpy(sizes_px[(..., *THIN)].ravel())
    mean, spread = inputs.mean(0), inputs.std(0)
    network = nn.Sequential(
        nn.Linear(inputs.shape[1], HIDDEN), nn.ReLU(), nn.Linear(HIDDEN, HIDDEN), nn.ReLU(),
        nn.Linear(HIDDEN, 2),
    )  # fmt: skip
    optimiser = torch.optim.AdamW(network.parameters(), lr=RATE)
    schedule = torch.optim.lr_scheduler.CosineAnnealingLR(optimiser, STEPS)
    for _ in range(STEPS):
        some = torch.randint(len(inputs), (BATCH,))
        logit, size = network((inputs[some] - mean) / spread).T
        loss = loss_of(logit, size, size_px[some], 1.0)
        optimiser.zero_grad()
        loss.backward()
        optimiser.step()
        schedule.step()

    def ask(image: GreyImage) -> tuple[FloatMap, FloatMap]:
        with torch.inference_mode():
            says = network((torch.from_numpy(energies(image)) - mean) / spread).numpy()
        return 1 / (1 + np.exp(-says[..., 0])), UNIT_PX * says[..., 1]

    return ask


def unet(kind: str, folder: Path, steps: int) -> Ask:
    """Trained on the samples of a folder, or as it was before: FOLDER-KIND.pt."""
    torch.manual_seed(0)
    network = UNETS[kind]().to(memory_format=torch.channels_last)
    weights = folder.with_name(f"{folder.name}-{kind}.pt")
    if weights.exists():
        network.load_state_dict(torch.load(weights, weights_only=True))
    else:
        train(network, *map(torch.from_numpy, samples(folder)), steps)
        torch.save(network.state_dict(), weights)
    network.eval()

    def ask(image: GreyImage) -> tuple[FloatMap, FloatMap]:
        with torch.inference_mode():
            logit, size = answers(network(torch.from_numpy(image[None, None] / np.float32(255))))
        return torch.sigmoid(logit[0]).numpy(), UNIT_PX * size[0].numpy()

    return ask


def train(network: nn.Module, images: Tensor, size_px: Tensor, steps: int) -> None:
    optimiser = torch.optim.AdamW(network.parameters(), lr=UNET_RATE)
    schedule = torch.optim.lr_scheduler.LambdaLR(
        optimiser, lambda k: min(1, (k + 1) / WARM_UP) * (0.5 + 0.5 * np.cos(np.pi * k / steps))
    )
    peak_px = size_px.amax((1, 2))
    clear = torch.nonzero((peak_px > CLEAR_PX) | (peak_px < STILL_PX)).ravel()
    for step in range(steps):
        among = clear if step < CLEAR_SHARE * steps else torch.arange(len(images))
        some, turns = among[torch.randint(len(among), (UNET_BATCH,))], int(torch.randint(8, ()))
        image, truth_px = (turned(each[some], turns) for each in (images, size_px))
        with torch.autocast("cpu", torch.bfloat16):
            logit, size = answers(network(image[:, None].float() / 255))
        loss = loss_of(logit, size, truth_px, SIZE_WEIGHT)
        optimiser.zero_grad()
        loss.backward()
        optimiser.step()
        schedule.step()
        if step % 100 == 99:
            print(f"step {step + 1} of {steps}: {loss.item():.3f}", flush=True)


def answers(says: Prediction) -> tuple[Tensor, Tensor]:
    """(N, H, W) logit, and size in units."""
    if says.logit is None:
        return says.displacement[:, 0].float(), says.displacement[:, 1].float()
    return says.logit[:, 0].float(), says.displacement[:, 0].float() / UNIT_PX


def turned(maps: Tensor, turns: int) -> Tensor:
    """(N, H, W) by quarters, and mirrored from the fourth on."""
    maps = maps.rot90(turns % 4, (1, 2))
    return maps.flip(2) if turns > 3 else maps


def noisy(image: GreyImage, seed: int) -> GreyImage:
    noise = NOISE_AFTER * np.random.default_rng([2, seed]).standard_normal(image.shape)
    return np.rint(image + noise).clip(0, 255).astype(np.uint8)


def judged(score: FloatMap, said: FloatMap, sizes: FloatMap, groups: Groups) -> list[str]:
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


def shifted(path: Path, seed: int, shift_px: float) -> dict[str, GreyImage]:
    """A photo moved as a whole, both ways."""
    rng = np.random.default_rng([3, seed])
    background = as_background(photo(rng, canvas_side(SIZE_PX), path))
    side = SIZE_PX + 2 * MARGIN_PX
    still, seed = np.zeros((side, side, 2), np.float32), int(rng.integers(2**32))
    there, here = (
        expose(background, [still], np.array([px, 0]), Optics(noise=1), np.random.default_rng(seed))
        for px in (shift_px, 0.0)
    )
    moved = np.zeros((SIZE_PX, SIZE_PX, 2), np.float32)
    moved[..., 0] = shift_px
    return {"camera": there, "bilinear": naive_warp(here, moved)}


def learnt(options: argparse.Namespace, folder: Path) -> Ask:
    if options.network == "perceptron":
        return perceptron(folder)
    return unet(options.network, folder, options.steps)


def table(options: argparse.Namespace) -> None:
    paths = held_out(options.photos)
    asks = {way: learnt(options, options.o / f"train-{way}") for way in WAYS}
    sets = {
        way: [
            s
            for shard in shards_in(options.o / f"test-{way}")
            for s in map(shard.sample, range(len(shard)))
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
            cells = judged(score, said, sizes, groups)
            print(f"| {trained} | {tested} | {' | '.join(cells)} |", flush=True)
    print("\n| moved by | trained on | "
          + " | ".join(f"{s} px" for s in SHIFTS_PX) + " |\n|" + "---|" * 6)  # fmt: skip
    moved = [[shifted(path, i, px) for i, path in enumerate(paths)] for px in SHIFTS_PX]
    for way in WAYS:
        for trained, ask in asks.items():
            means = [np.mean([ask(images[way])[0].mean() for images in row]) for row in moved]
            print(f"| {way} | {trained} | {' | '.join(f'{m:.3f}' for m in means)} |", flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("task", choices=["render", "table"])
    parser.add_argument("--photos", type=Path)
    parser.add_argument("--runs", type=Path)
    parser.add_argument("--samples", type=int, default=4096)
    parser.add_argument("--network", choices=["perceptron", *UNETS], default="perceptron")
    parser.add_argument("--steps", type=int, default=2200)
    parser.add_argument("-o", type=Path, required=True)
    options = parser.parse_args()
    cv2.setNumThreads(1)
    torch.set_num_threads(1)
    {"render": render, "table": table}[options.task](options)


if __name__ == "__main__":
    main()
