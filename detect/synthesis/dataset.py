"""Samples rendered ahead into a folder of shards, so that training need not wait for them."""

import json
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import partial
from multiprocessing import get_context
from pathlib import Path
from typing import Any, Self

import cv2
import numpy as np
from numpy.typing import NDArray

from detect.synthesis.recipe import FAMILIES, SAMPLE_FAMILIES, Recipe
from detect.synthesis.sample import Sample, Sources, photos_of, sample_at
from geometry.arrays import BoolArray
from geometry.atomic import write_text_atomic
from geometry.errors import BadInputError, UnwritableError
from geometry.npz import as_float32, check_numbers, open_arrays, save_arrays
from geometry.text_files import read_json

SCHEMA = "locate.samples/1"
INDEX_NAME = "dataset.json"
SHARD_SAMPLES = 256
"""Samples in a file."""
HalfArray = NDArray[np.float16]


@dataclass(frozen=True, kw_only=True)
class Shard:
    """N samples in one file.

    Attributes:
        images: (N, H, W) uint8, or (N, H, W, C) float16 channels that were measured in them.
        displacements: (N, H, W, 2) float16, px.
        masks: (N, H, W).
        families: (N,) index into `SAMPLE_FAMILIES`.
    """

    images: NDArray[np.uint8] | HalfArray
    displacements: HalfArray
    masks: BoolArray
    families: NDArray[np.uint8]

    @classmethod
    def from_samples(cls, samples: list[Sample]) -> Self:
        """Packs samples of one size."""
        return cls(
            images=np.stack([sample.image for sample in samples]),
            displacements=np.stack([s.displacement for s in samples]).astype(np.float16),
            masks=np.stack([sample.mask for sample in samples]),
            families=np.array([SAMPLE_FAMILIES.index(s.family) for s in samples], dtype=np.uint8),
        )

    def __len__(self) -> int:
        return len(self.images)

    def sample_at(self, i: int) -> Sample:
        """Sample `i` of this shard."""
        return Sample(
            image=self.images[i],
            displacement=self.displacements[i].astype(np.float32),
            mask=self.masks[i],
            family=SAMPLE_FAMILIES[self.families[i]],
        )

    def save(self, path: Path, **more: np.ndarray) -> None:
        """Writes all or nothing; arrays named in `more` go with it, and `load` leaves them out."""
        save_arrays(
            path,
            images=self.images,
            displacements=self.displacements,
            masks=np.packbits(self.masks, axis=-1),
            families=self.families,
            **more,
        )

    @classmethod
    def load(cls, path: Path) -> Self:
        """Reads what `save` wrote.

        Raises:
            BadInputError: The file is missing or broken.
        """
        with open_arrays(path, "a shard of samples") as file:
            displacements = file["displacements"]
            masks = np.unpackbits(file["masks"], axis=-1, count=displacements.shape[-2])
            found = cls(
                images=file["images"],
                displacements=displacements,
                masks=masks.astype(bool),
                families=file["families"],
            )
            found._check()
            return found

    def _check(self) -> None:
        check_numbers(images=self.images, displacements=self.displacements)
        as_float32(self.displacements)
        shape = self.masks.shape
        fitting = self.displacements.shape == (*shape, 2) and self.images.shape[:3] == shape
        if len(shape) != 3 or not fitting or self.families.shape != shape[:1]:
            raise ValueError("the shapes of its arrays do not fit each other")
        if self.families.dtype != np.uint8 or (self.families >= len(SAMPLE_FAMILIES)).any():
            raise ValueError("it holds samples of an unknown family")


def render_dataset(recipe: Recipe, count: int, folder: Path, *, processes: int = 1) -> list[Path]:
    """Writes samples 0 to `count` of a recipe into FOLDER; shards that stand there are kept.

    A killed rendering continues where it stood when it is called again, and a larger `count` adds
    to what is there.

    Args:
        recipe: What to render.
        count: How many samples.
        folder: Made where it is missing.
        processes: How many work at once, each on one thread.

    Returns:
        The shards, in order.

    Raises:
        BadInputError: The folder holds samples of another recipe, or of other photos or runs.
    """
    sources = Sources.from_recipe(recipe)
    _claim_folder(folder, recipe, sources)
    jobs = [
        (folder / f"shard_{first // SHARD_SAMPLES:05d}.npz", range(first, count)[:SHARD_SAMPLES])
        for first in range(0, count, SHARD_SAMPLES)
    ]
    missing = [(path, indices) for path, indices in jobs if _count_samples(path) < len(indices)]
    render = partial(_render_shard, recipe, sources)
    if processes == 1:
        for job in missing:
            render(job)
    else:
        with ProcessPoolExecutor(processes, mp_context=get_context("spawn")) as pool:
            list(pool.map(render, missing))
    return [path for path, _ in jobs]


def shards_in(folder: Path) -> Iterator[Shard]:
    """The shards of a rendered folder, one after the other.

    Raises:
        BadInputError: The folder holds no samples, or a broken shard.
    """
    read_index(folder)
    for path in sorted(folder.glob("shard_*.npz")):
        yield Shard.load(path)


def _render_shard(recipe: Recipe, sources: Sources, job: tuple[Path, range]) -> None:
    path, indices = job
    cv2.setNumThreads(1)
    Shard.from_samples([sample_at(index, recipe, sources) for index in indices]).save(path)


def _count_samples(path: Path) -> int:
    """How many samples a shard holds, 0 where there is none."""
    if not path.exists():
        return 0
    with open_arrays(path, "a shard of samples") as file:
        return len(file["families"])


def _claim_folder(folder: Path, recipe: Recipe, sources: Sources) -> None:
    """Writes the index, or checks that the folder's own is the same."""
    index = {
        "schema": SCHEMA,
        "recipe": recipe.to_plain(),
        "photos": [path.name for path in sources.photos],
        "runs": [path.name for path in sources.runs],
        "families": list(FAMILIES),
    }
    if not (folder / INDEX_NAME).exists():
        write_index(folder, index)
    elif read_index(folder) != index:
        raise _other_recipe(folder)


def check_recipe(folder: Path, recipe: Recipe) -> None:
    """Checks, before anything is rendered, what `render_dataset` needs beside simulated runs.

    Args:
        folder: For the samples; it need not be there.
        recipe: What to render.

    Raises:
        BadInputError: The folder holds samples of another recipe, or photos are missing.
    """
    photos_of(recipe)
    if (folder / INDEX_NAME).exists() and read_index(folder).get("recipe") != recipe.to_plain():
        raise _other_recipe(folder)


def _other_recipe(folder: Path) -> BadInputError:
    return BadInputError(f"{folder}: holds samples of another recipe, name a new folder")


def write_index(folder: Path, index: dict[str, Any]) -> None:
    """Writes FOLDER/dataset.json, all or nothing; the folder is made where it is missing.

    Raises:
        BadInputError: It cannot be written.
    """
    path = folder / INDEX_NAME
    try:
        folder.mkdir(parents=True, exist_ok=True)
        write_text_atomic(path, json.dumps(index, indent=1))
    except OSError as error:
        raise UnwritableError.of(folder, error) from error


def read_index(folder: Path) -> dict[str, Any]:
    """The content of dataset.json.

    Raises:
        BadInputError: It is missing, broken or of another schema.
    """
    path = folder / INDEX_NAME
    index = read_json(path)
    if not isinstance(index, dict) or index.get("schema") != SCHEMA:
        raise BadInputError(f"{path}: not an index of samples of schema {SCHEMA}")
    return index
