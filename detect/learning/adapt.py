"""A trained network taught one background more: a short training that begins with its weights."""

import tempfile
from collections.abc import Mapping
from pathlib import Path

import onnx

from detect.learning.checkpoint import read_checkpoint
from detect.learning.config import (
    AugmentationConfig,
    LossConfig,
    PoolConfig,
    TrainConfig,
    TrainingStage,
)
from detect.learning.export import save_network
from detect.learning.reread import read_network
from detect.learning.trainer import train_network
from detect.synthesis import Shard
from detect.synthesis.dataset import SCHEMA, write_index
from geometry.reports import Report

HAZE, PLUMES, HELD = "haze", "plumes", "held"
BACKGROUND_SHARE = 0.6
SEED = 0


def fine_tune(
    start: Path,
    haze: Shard,
    plumes: Shard,
    held: Shard,
    path: Path,
    *,
    steps: int,
    data: str,
    metadata: Mapping[str, str],
    report: Report,
) -> None:
    """Trains a network on and writes it.

    Args:
        start: The .onnx file to begin with, fp32.
        haze: Samples that are displaced all over: they teach the background.
        plumes: Samples with plumes and without.
        held: Samples to watch it by.
        path: The .onnx file to write.
        steps: How many.
        data: A line for the metadata: what it learned from.
        metadata: More of it.
        report: Called with the progress, (what, share done).

    Raises:
        BadInputError: The start is not a network of ours, or PATH cannot be written.
    """
    began = read_network(start)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for pool, shard in ((HAZE, haze), (PLUMES, plumes), (HELD, held)):
            write_index(folder / pool, {"schema": SCHEMA})
            shard.save(folder / pool / "shard_00000.npz")
        config = TrainConfig(
            name=f"{began.name}-adapted",
            network=began.config,
            pools={pool: PoolConfig(folder=folder / pool) for pool in (HAZE, PLUMES, HELD)},
            validation=HELD,
            stages=_adaptation_stages(steps),
            augmentation=AugmentationConfig(symmetries="none"),
            mixed_precision=False,
            seed=SEED,
            checkpoint_every=steps,
            validate_every=steps,
            initial=start,
        )
        weights = {"network": began.network.state_dict()}
        last = train_network(config, folder / "run", report=report, initial=weights)
        began.network.load_state_dict(read_checkpoint(last)["network"])
    trained_on = {"start": began.name, "steps": steps, "data": data}
    channels = began.config.channels
    save_network(began.network.eval(), path, config.name, channels, trained_on)
    model = onnx.load(path)
    props = {entry.key: entry.value for entry in model.metadata_props}
    onnx.helper.set_model_props(model, props | dict(metadata))
    onnx.save(model, path)


def _adaptation_stages(steps: int) -> tuple[TrainingStage, TrainingStage]:
    """Squared errors throughout: most pixels are still, and others lead to an answer of zero."""
    first = round(BACKGROUND_SHARE * steps)
    return (
        TrainingStage(
            name="background",
            pools={HAZE: 1},
            steps=first,
            learning_rate=(3e-3, 1e-5),
            losses=LossConfig(charbonnier=0, squared=0.1, mask=0),
        ),
        TrainingStage(
            name="plumes",
            pools={HAZE: 1, PLUMES: 2},
            steps=steps - first,
            learning_rate=(1e-3, 1e-5),
            losses=LossConfig(charbonnier=0, squared=0.2, mask=1, likelihood=0.05),
        ),
    )
