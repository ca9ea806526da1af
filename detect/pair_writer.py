"""Recorded (frame, flow) pairs, cut into crops and packed as shards of `detect.synthesis`."""

from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

from detect.synthesis.dataset import INDEX_NAME, SCHEMA, Shard, read_index, write_index
from detect.synthesis.recipe import SAMPLE_FAMILIES
from detect.synthesis.sample import Sample
from detect.synthesis.split import Split
from geometry.arrays import FloatMap, GreyImage, IntArray
from geometry.errors import BadInputError

SHARD_PIXELS = 256 * 128**2
VISIBLE_PX = 0.05


class PairWriter:
    """Gathers the crops of one recording in a scratch folder, then adds them to a dataset.

    Args:
        scratch: An empty folder on the dataset's own disk.
        name: Of the recording; it is part of the shards' names.
        size_px: Side of the crops.
    """

    def __init__(self, scratch: Path, name: str, size_px: int) -> None:
        self._scratch, self._name, self._size_px = scratch, name, size_px
        self._samples: list[Sample] = []
        self._places: list[tuple[int, int, int]] = []
        self._shards: list[Path] = []
        self.crops = 0

    def add_crops(self, index: int, image: GreyImage, displacement: FloatMap) -> None:
        """Cuts frame `index` and its (H, W, 2) displacement into crops that cover it."""
        for x, y in crop_corners(image.shape, self._size_px):
            part = np.s_[y : y + self._size_px, x : x + self._size_px]
            mask = np.linalg.norm(displacement[part], axis=-1) > VISIBLE_PX
            self._samples.append(
                Sample(
                    image=image[part], displacement=displacement[part], mask=mask, family="recorded"
                )
            )
            self._places.append((index, int(x), int(y)))
            if len(self._samples) * self._size_px**2 >= SHARD_PIXELS:
                self._pack_shard()

    def publish_shards(self, folder: Path, split: Split) -> None:
        """Moves the shards into FOLDER/split, after what it held of a recording of that name.

        Raises:
            BadInputError: The folder holds something else.
        """
        self._pack_shard()
        index = pairs_index(folder / split, self._size_px)
        index["recordings"] = sorted({*index["recordings"], self._name})
        write_index(folder / split, index)
        for path in self._shards:
            path.replace(folder / split / path.name)

    def _pack_shard(self) -> None:
        if self._samples:
            path = self._scratch / f"shard_{self._name}_{len(self._shards):05d}.npz"
            Shard.from_samples(self._samples).save(path, places=np.array(self._places, np.int32))
            self._shards.append(path)
            self.crops += len(self._samples)
        self._samples, self._places = [], []


def remove_recording(folder: Path, name: str) -> None:
    """Takes a recording out of every split of the dataset in FOLDER."""
    for path in folder.glob(f"*/{INDEX_NAME}"):
        index = read_index(path.parent)
        if name not in index.get("recordings", ()):
            continue
        index["recordings"].remove(name)
        write_index(path.parent, index)
        for shard in path.parent.glob("shard_*.npz"):
            if shard.stem.rpartition("_")[0] == f"shard_{name}":
                shard.unlink()


def pairs_index(folder: Path, size_px: int) -> dict[str, Any]:
    """The index of a folder of recorded crops of that size, a new one where there is none.

    Raises:
        BadInputError: The folder holds samples of another kind or size.
    """
    fresh = {
        "schema": SCHEMA,
        "size_px": size_px,
        "recordings": [],
        "families": list(SAMPLE_FAMILIES),
    }
    if not (folder / INDEX_NAME).exists():
        return fresh
    index = read_index(folder)
    if index.keys() != fresh.keys() or index["size_px"] != size_px:
        size = index.get("size_px")
        held = f"crops of {size} px" if size else "rendered samples"
        raise BadInputError(f"{folder}: holds {held}, name a new folder")
    return index


def crop_corners(shape: tuple[int, ...], size_px: int) -> IntArray:
    """(N, 2) top-left corners (x, y) of the fewest evenly spread crops that cover the frame.

    Raises:
        BadInputError: The frame is smaller than a crop.
    """
    height, width = shape
    if min(shape) < size_px:
        raise BadInputError(
            f"frames of {width}x{height} are too small for crops of {size_px} px; "
            f"take --size {min(shape)} or less"
        )
    across, down = (
        np.linspace(0, side - size_px, -(-side // size_px)).round().astype(int)
        for side in (width, height)
    )
    return np.array(list(product(across, down)))
