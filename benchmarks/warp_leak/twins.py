"""Every sample twice, of one part of a photo and one plume: by a camera, and by a software warp."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from detect.synthesis import FAMILIES, Recipe, Sample, Shard, Sources, shards_in
from detect.synthesis.camera import MARGIN_PX, CameraOptics, expose_background, naive_warp
from detect.synthesis.dataset import SCHEMA, SHARD_SAMPLES, write_index
from detect.synthesis.raster import as_background, canvas_side, crop_photo, find_photos
from detect.synthesis.sample import render_through_plume
from geometry.arrays import FloatMap, GreyImage

WAYS = ("bilinear", "camera")
SIZE_PX, CROPS = 96, 16
NOISE_AFTER = 2.0


def held_out(photos: Path) -> list[Path]:
    return [*find_photos(photos, "validation"), *find_photos(photos, "test")]


def twins(rng: np.random.Generator, path: Path, runs: tuple[Path, ...]) -> dict[str, Sample]:
    """One part of a photo through one plume, or none, both ways."""
    recipe = Recipe(
        size_px=SIZE_PX, families={"photo": 1}, photos=path, exposures=1, gamma=(1, 1), jpeg_share=0
    )
    background = as_background(crop_photo(rng, canvas_side(SIZE_PX), path))
    seed, still = rng.integers(2**32), recipe.model_copy(update={"negatives": 1.0})
    view, without = (
        render_through_plume(
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
            Shard.from_samples([pair[way] for pair in pairs]).save(path)
        print(f"{folder.name}: {first + len(pairs)} of {count}", flush=True)


def samples(folder: Path) -> tuple[GreyImage, FloatMap]:
    """(N, H, W) images of a folder and |w| in them, px."""
    shards = list(shards_in(folder))
    sizes = [np.linalg.norm(s.displacements.astype(np.float32), axis=-1) for s in shards]
    images = np.concatenate([shard.images for shard in shards])
    return images.reshape(images.shape[:3]), np.concatenate(sizes)


def noisy(image: GreyImage, seed: int) -> GreyImage:
    noise = NOISE_AFTER * np.random.default_rng([2, seed]).standard_normal(image.shape)
    return np.rint(image + noise).clip(0, 255).astype(np.uint8)


def shifted(path: Path, seed: int, shift_px: float) -> dict[str, GreyImage]:
    """A photo moved as a whole, both ways."""
    rng = np.random.default_rng([3, seed])
    background = as_background(crop_photo(rng, canvas_side(SIZE_PX), path))
    side = SIZE_PX + 2 * MARGIN_PX
    still, seed = np.zeros((side, side, 2), np.float32), int(rng.integers(2**32))
    there, here = (
        expose_background(
            background,
            [still],
            np.array([px, 0]),
            CameraOptics(noise=1),
            np.random.default_rng(seed),
        )
        for px in (shift_px, 0.0)
    )
    moved = np.zeros((SIZE_PX, SIZE_PX, 2), np.float32)
    moved[..., 0] = shift_px
    return {"camera": there, "bilinear": naive_warp(here, moved)}
