"""The training loop: it can be killed at any step and goes on to the same weights."""

import json
import math
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

import numpy as np
import torch
from torch import Tensor, nn
from torch.nn.utils import convert_conv2d_weight_memory_format

from detect.learning import losses
from detect.learning.batches import StageBatches, TrainingBatch
from detect.learning.checkpoint import (
    append_to_journal,
    load_weights,
    read_checkpoint,
    rewind_journal,
    write_checkpoint,
)
from detect.learning.config import TrainConfig, TrainingStage
from detect.learning.networks import Prediction, build_network
from detect.learning.pools import SamplePool
from detect.learning.reread import read_network, revive_norms
from detect.learning.validation import ValidationScore, validate_network
from geometry.atomic import write_text_atomic
from geometry.errors import BadInputError, UnwritableError
from geometry.reports import Report

LAST, BEST, BEFORE, CONFIG = "last.pt", "best.pt", "before.pt", "config.json"
BETAS = (0.9, 0.999)
"""Of Adam (Kingma and Ba, ICLR 2015), their defaults."""
NORM_BATCHES = 4
"""Batches by which an exported network, whose BatchNorms were folded away, gets them back."""


def train_network(
    config: TrainConfig, folder: Path, *, report: Report, initial: Mapping[str, Any] | None = None
) -> Path:
    """Trains, or continues from FOLDER's checkpoint.

    On one thread the weights do not depend on how often it was killed.

    Args:
        config: What to train on what.
        folder: For checkpoints and the journal; made where it is missing.
        report: Called with the progress, (what, share done).
        initial: A checkpoint, or what one would hold, of `config.initial` where that is read
            already.

    Returns:
        The last checkpoint.

    Raises:
        BadInputError: A pool is missing, or the checkpoint is of a config that leads elsewhere.
    """
    training = TrainingRun.begin(config, folder, initial)
    training.run(report)
    return folder / LAST


@contextmanager
def _naming_lack_of_memory(folder: Path) -> Iterator[None]:
    """Torch says by a RuntimeError that memory is short.

    Raises:
        BadInputError: It does.
    """
    try:
        yield
    except (MemoryError, RuntimeError) as error:
        if isinstance(error, RuntimeError) and "memory" not in str(error):
            raise
        raise BadInputError(
            f"{folder}: too little memory; lower batch, crop_px or the network's width"
        ) from error


@dataclass(kw_only=True)
class TrainingRun:
    """A training under way: the network and its optimiser, changed by each step.

    Attributes:
        config: The schedule.
        folder: Where it is kept.
        network: In training.
        optimiser: Of its weights.
        device: Where it computes.
        step: How many are done.
        best: The best mean AUROC so far.
    """

    config: TrainConfig
    folder: Path
    network: nn.Module
    optimiser: torch.optim.Optimizer
    device: torch.device
    step: int = 0
    best: float = -math.inf

    @classmethod
    def begin(
        cls, config: TrainConfig, folder: Path, initial: Mapping[str, Any] | None = None
    ) -> Self:
        """Fresh weights, those that `config` begins with, or those of FOLDER's checkpoint.

        Samples are not read, so that they need not be there yet. Arguments and errors are those of
        `train_network`.
        """
        torch.manual_seed(config.seed)
        device = torch.device("cuda" if torch.cuda.is_available() else "cpu")
        with _naming_lack_of_memory(folder):
            network = build_network(config.network).to(device)
            convert_conv2d_weight_memory_format(network, torch.channels_last)
        if config.initial is not None:
            load_weights(network, initial or _read_initial(config.initial), config.initial)
        training = cls(
            config=config,
            folder=folder,
            network=network,
            optimiser=_build_optimiser(config, network),
            device=device,
        )
        try:
            folder.mkdir(parents=True, exist_ok=True)
            if (folder / LAST).exists():
                training._resume_from(folder / LAST)
            write_text_atomic(folder / CONFIG, json.dumps(config.to_plain(), indent=1))
        except OSError as error:
            raise UnwritableError.of(folder, error) from error
        rewind_journal(folder, training.step)
        return training

    def run(self, report: Report) -> None:
        """Trains to the end of the schedule; a stage's samples are read when it begins."""
        pools: dict[str, SamplePool] = {}
        for first, stage in self.config.stage_starts():
            if self.step < first + stage.steps:
                pools = self._load_pools(stage, pools)
                batches = StageBatches(self.config, stage, pools)
                with _naming_lack_of_memory(self.folder):
                    self._revive_norms(batches)
                    self._run_stage(first, stage, batches, pools[self.config.validation], report)

    def _revive_norms(self, batches: StageBatches) -> None:
        """Gives an exported network, before its first step, the BatchNorms that it lost."""
        if self.step == 0 and _is_exported(self.config.initial):
            images = [batches[step].image for step in range(NORM_BATCHES)]
            revive_norms(self.network, torch.from_numpy(np.concatenate(images)).to(self.device))

    def _run_stage(
        self,
        first: int,
        stage: TrainingStage,
        batches: StageBatches,
        validation: SamplePool,
        report: Report,
    ) -> None:
        config, recent = self.config, _RunningMean()
        last = first + stage.steps
        if stage.blend < 1 and self.step == first:
            self.save(BEFORE)
        while self.step < last:
            rate = _learning_rate(stage, self.step - first)
            recent.add(self._train_step(batches[self.step], stage, rate))
            if stage.blend < 1 and self.step == last:
                self._blend_weights(stage.blend)
            if self.step % config.log_every == 0:
                self._write_journal(kind="train", stage=stage.name, loss=recent.take(), rate=rate)
            if self.step % config.validate_every == 0 or self.step == config.steps:
                self._validate_pool(stage, validation)
            if self.step % config.checkpoint_every == 0 or self.step == last:
                self.save(LAST)
            report(stage.name, (self.step - first) / stage.steps)

    def _load_pools(
        self, stage: TrainingStage, loaded: Mapping[str, SamplePool]
    ) -> dict[str, SamplePool]:
        names = [*stage.pools, self.config.validation]
        kept = {name: loaded[name] for name in names if name in loaded}
        pools = {
            name: kept[name] if name in kept else SamplePool.load(self.config.pools[name])
            for name in names
        }
        for name, pool in pools.items():
            found, taken = pool.images.shape[-1], self.config.network.channels
            if found != taken:
                folder = self.config.pools[name].folder
                raise BadInputError(
                    f"{folder}: samples of {found} channels, the network has {taken}"
                )
        return pools

    def save(self, name: str) -> None:
        """Writes a checkpoint, whole or not at all."""
        write_checkpoint(
            self.folder / name,
            {
                "digest": self.config.weights_digest(self.step),
                "step": self.step,
                "best": self.best,
                "network": self.network.state_dict(),
                "optimiser": self.optimiser.state_dict(),
            },
        )

    def _train_step(self, batch: TrainingBatch, stage: TrainingStage, rate: float) -> float:
        for group in self.optimiser.param_groups:
            group["lr"] = rate
        self.network.train()
        image = torch.from_numpy(batch.image).to(self.device, memory_format=torch.channels_last)
        truth = torch.from_numpy(batch.displacement).to(self.device)
        limits_px = torch.from_numpy(batch.limits_px).to(self.device)
        loss = losses.total_loss(self._predict_maps(image), truth, stage.losses, limits_px)
        self.optimiser.zero_grad()
        torch.autograd.backward(loss)
        self.optimiser.step()
        self.step += 1
        value = float(loss.detach())
        if not math.isfinite(value):
            raise BadInputError(
                f"{self.folder}: the loss is {value} at step {self.step}; lower the learning rate"
            )
        return value

    def _blend_weights(self, share: float) -> None:
        before = read_checkpoint(self.folder / BEFORE)["network"]
        with torch.no_grad():
            for name, after in self.network.state_dict().items():
                if after.is_floating_point():
                    after.lerp_(before[name].to(after.device), 1 - share)

    def _predict_maps(self, image: Tensor) -> Prediction:
        with torch.autocast(self.device.type, torch.bfloat16, enabled=self.config.mixed_precision):
            prediction: Prediction = self.network(image)
        return prediction

    def _validate_pool(self, stage: TrainingStage, pool: SamplePool) -> None:
        self.network.eval()
        with torch.inference_mode():
            scores = validate_network(self._predict_arrays, pool, self.config)
        self._write_journal(
            kind="validation",
            stage=stage.name,
            families={name: score.to_plain() for name, score in scores.items()},
        )
        mean = _mean_auroc(scores)
        if mean > self.best or not (self.folder / BEST).exists():
            self.best = mean
            self.save(BEST)

    def _predict_arrays(self, image: np.ndarray) -> dict[str, np.ndarray]:
        tensor = torch.from_numpy(image).to(self.device, memory_format=torch.channels_last)
        prediction: Prediction = self.network(tensor)
        known = {name: map_ for name, map_ in prediction._asdict().items() if map_ is not None}
        return {name: map_.cpu().numpy() for name, map_ in known.items()}

    def _resume_from(self, path: Path) -> None:
        content = read_checkpoint(path)
        if content["digest"] != self.config.weights_digest(content["step"]):
            raise BadInputError(
                f"{path}: trained with another config for its first {content['step']} steps; "
                "restore that config or name a new folder"
            )
        load_weights(self.network, content, path)
        try:
            self.optimiser.load_state_dict(content["optimiser"])
        except (KeyError, TypeError, ValueError) as error:
            raise BadInputError(f"{path}: not the state of the config's optimiser") from error
        self.step, self.best = content["step"], content["best"]

    def _write_journal(self, **line: Any) -> None:
        append_to_journal(self.folder, {"step": self.step} | line)


def _is_exported(initial: Path | None) -> bool:
    return initial is not None and initial.suffix == ".onnx"


def _read_initial(path: Path) -> Mapping[str, Any]:
    """A checkpoint, or what one would hold of an exported network."""
    if _is_exported(path):
        return {"network": read_network(path).network.state_dict()}
    return read_checkpoint(path)


class _RunningMean:
    """Of what was added since it was last taken."""

    def __init__(self) -> None:
        self._sum, self._count = 0.0, 0

    def add(self, value: float) -> None:
        self._sum, self._count = self._sum + value, self._count + 1

    def take(self) -> float:
        mean = self._sum / max(self._count, 1)
        self._sum, self._count = 0.0, 0
        return mean


def _build_optimiser(config: TrainConfig, network: nn.Module) -> torch.optim.Optimizer:
    if config.optimiser == "adam":
        return torch.optim.Adam(network.parameters(), betas=BETAS, fused=True)
    return torch.optim.AdamW(
        network.parameters(), betas=BETAS, weight_decay=config.weight_decay, fused=True
    )


def _learning_rate(stage: TrainingStage, step: int) -> float:
    start, end = stage.learning_rate
    share = step / (stage.cosine_steps or stage.steps)
    return end + (start - end) * (1 + math.cos(math.pi * share)) / 2


def _mean_auroc(scores: Mapping[str, ValidationScore]) -> float:
    known = [score.auroc for score in scores.values() if math.isfinite(score.auroc)]
    return float(np.mean(known)) if known else -math.inf
