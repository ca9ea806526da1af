"""The samples that a training needs and that are not there yet."""

from pathlib import Path

from detect.learning.clips import check_clip, list_clips
from detect.learning.config import PoolConfig, TrainConfig
from detect.synthesis import Recipe, render_dataset, write_run
from detect.synthesis.dataset import SHARD_SAMPLES, check_recipe
from geometry.errors import BadInputError
from geometry.npz import open_arrays
from geometry.reports import Report


def render_missing(config: TrainConfig, data: Path, *, report: Report, processes: int = 1) -> None:
    """Renders every pool that has a recipe and too few samples; hours for tens of thousands.

    Args:
        config: Of the training.
        data: What the recipes' folders of photos and flows are relative to.
        report: Called with the progress, (what, share done).
        processes: How many work at once.

    Raises:
        BadInputError: A recipe is broken, or a folder holds samples of another one.
    """
    for name, pool in config.pools.items():
        count = pool.samples or 0
        if pool.recipe is None or _count_rendered(pool.folder) >= count:
            continue
        recipe = Recipe.load(pool.recipe, data)
        if recipe.flows is not None:
            for number in range(config.runs):
                write_run(recipe.flows, number)
                report("flows", (number + 1) / config.runs)
        at_once = SHARD_SAMPLES * processes
        for end in range(at_once, count + at_once, at_once):
            render_dataset(recipe, min(end, count), pool.folder, processes=processes)
            report(f"samples: {name}", min(end, count) / count)


def check_samples(config: TrainConfig, data: Path) -> None:
    """Checks, before anything is rendered or learned, that all samples are there or can be made.

    Args:
        config: Of the training.
        data: As of `render_missing`.

    Raises:
        BadInputError: Samples or photos are missing, a file is broken, a recipe is broken or
            another than that of the samples that are there.
    """
    for pool in config.pools.values():
        clips = list_clips(pool.folder)
        for path in clips:
            check_clip(path)
        if pool.seeds is not None or clips:
            continue
        source = pool.measured or pool.folder
        there = _check_rendered(source)
        made = [other.samples or 0 for other in config.pools.values() if _makes(other, source)]
        if max([there, *made]) < (pool.samples or 1):
            raise BadInputError(
                f"{source}: {there} of {pool.samples or 1} samples; render the others, or name "
                "their folder's place with --data"
            )
        if pool.recipe is not None and there < (pool.samples or 0):
            check_recipe(pool.folder, Recipe.load(pool.recipe, data))


def _makes(pool: PoolConfig, folder: Path) -> bool:
    return pool.recipe is not None and pool.folder == folder


def _check_rendered(folder: Path) -> int:
    """How many samples stand in a folder, none of whose files is cut short."""
    for path in folder.glob("shard_*.npz"):
        with open_arrays(path, "a shard of samples"):
            pass
    return _count_rendered(folder)


def _count_rendered(folder: Path) -> int:
    """How many samples stand in a folder; all its files but the last are full."""
    files = sorted(folder.glob("shard_*.npz"))
    if not files:
        return 0
    with open_arrays(files[-1], "a shard of samples") as last:
        return SHARD_SAMPLES * (len(files) - 1) + len(last["families"])
