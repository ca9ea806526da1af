"""The samples that a training needs and that are not there yet."""

from pathlib import Path

from detect.learning.config import TrainConfig
from detect.synthesis import Recipe, render_dataset, write_run
from detect.synthesis.dataset import SHARD_SAMPLES
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


def _count_rendered(folder: Path) -> int:
    """How many samples stand in a folder; all its files but the last are full."""
    files = sorted(folder.glob("shard_*.npz"))
    if not files:
        return 0
    with open_arrays(files[-1], "a shard of samples") as last:
        return SHARD_SAMPLES * (len(files) - 1) + len(last["families"])
