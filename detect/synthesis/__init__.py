"""Synthetic training data whose images are formed as a camera forms them."""

from detect.synthesis.dataset import Shard, render_dataset, shards_in
from detect.synthesis.flows import write_run
from detect.synthesis.recipe import FAMILIES, SAMPLE_FAMILIES, Recipe
from detect.synthesis.sample import Sample, Sources, make_sample, sample_at

__all__ = [
    "FAMILIES",
    "SAMPLE_FAMILIES",
    "Recipe",
    "Sample",
    "Shard",
    "Sources",
    "make_sample",
    "render_dataset",
    "sample_at",
    "shards_in",
    "write_run",
]
