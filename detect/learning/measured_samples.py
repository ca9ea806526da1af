"""Rendered samples as the channels that waves and edges measure in them."""

from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np

from detect.dybs.pattern_measurement import CHANNELS, measure_pattern, network_channels
from detect.synthesis.dataset import SHARD_SAMPLES, Shard, read_index, shards_in, write_index
from detect.texture import texture_classes


def measured_shard(shard: Shard) -> Shard:
    """The shard's samples as channels, truth and masks at half resolution."""
    planes = [
        network_channels(measure_pattern(image, texture_classes(image))) for image in shard.images
    ]
    height, width = planes[0].shape[1:]
    truth = [
        cv2.resize(w.astype(np.float32), (width, height), interpolation=cv2.INTER_AREA)
        for w in shard.displacements
    ]
    return Shard(
        images=np.moveaxis(np.stack(planes), 1, -1).astype(np.float16),
        displacements=np.stack(truth).astype(np.float16),
        masks=shard.masks[:, ::2, ::2],
        families=shard.families,
    )


def measure_samples(samples: Path, folder: Path, count: int | None = None) -> Iterator[float]:
    """Writes the channels of the first samples of a folder, in whole shards, into another.

    Shards that stand there are kept.

    Args:
        samples: As `detect.synthesis.render_dataset` writes them.
        folder: Made where it is missing.
        count: How many; all that are there if left out.

    Yields:
        The share that is done.

    Raises:
        BadInputError: A folder cannot be read or written.
    """
    write_index(folder, read_index(samples) | {"channels": CHANNELS})
    numbers = range(len(list(samples.glob("shard_*.npz"))))
    wanted = numbers if count is None else numbers[: -(-count // SHARD_SAMPLES)]
    for number, shard in zip(wanted, shards_in(samples), strict=False):
        path = folder / f"shard_{number:05d}.npz"
        if not path.exists():
            measured_shard(shard).save(path)
        yield (number + 1) / len(wanted)
