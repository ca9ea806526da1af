"""The settings of a training; no torch here."""

import hashlib
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Any, Literal, Self

from pydantic import ConfigDict, Field, NonNegativeInt, ValidationError, model_validator

from detect.learning.clips import Leaks
from geometry.errors import BadInputError, first_complaint
from geometry.plain_settings import PlainSettings
from geometry.text_files import read_yaml

Weight = Annotated[float, Field(ge=0, le=1e6)]
LearningRate = Annotated[float, Field(ge=0, le=10)]
Gain = Annotated[float, Field(gt=0, le=100)]
Seed = Annotated[int, Field(ge=0, lt=2**32)]
Steps = Annotated[int, Field(ge=1, le=10**9)]
MOST_SEEDS = 10**6
"""Of a pool; a clip takes some 20 s of CPU. All limits here are chosen, far from what is useful."""


class _TrainingSettings(PlainSettings):
    model_config = ConfigDict(allow_inf_nan=False)


class NetworkConfig(_TrainingSettings):
    """Which network.

    Attributes:
        kind: ``plume`` is ours, ``paper`` the paper's.
        channels: Of the input: 1 for grey, 3 for colour, more for features.
        width: Channels at its finest level.
        normalise: Whether local mean and contrast are taken out within it (``plume``).
    """

    kind: Literal["plume", "paper"] = "plume"
    channels: int = Field(default=1, ge=1, le=256)
    width: int = Field(default=16, ge=1, le=512)
    normalise: bool = True


class PoolConfig(_TrainingSettings):
    """Where rendered samples are.

    Attributes:
        folder: As `detect.synthesis.render_dataset` writes it.
        samples: The first so many; all that are there if left out.
        seeds: Of clips, ranges (first, after last), where the pool is made of these instead of
            rendered samples.
        photos: That the scenes of the clips are made of; plants where left out. Beside the
            folders of samples.
        leaks: Where the plumes of those scenes leave.
        rough: Whether those photos are filmed as by people who never thought of refraction.
        coded: Whether the clips are stored as videos of few bits.
        photo_set: Folder of posed photos that the clips are made of instead.
        recipe: What they are rendered from where they are missing; relative to the config file.
        measured: A folder of rendered samples; these are what waves and edges measure in them.
    """

    folder: Path
    recipe: Path | None = None
    measured: Path | None = None
    samples: int | None = Field(default=None, ge=1, le=10**8)
    seeds: tuple[tuple[Seed, Seed], ...] | None = Field(default=None, min_length=1)
    photos: Path | None = None
    leaks: Leaks = "nozzle"
    rough: bool = False
    coded: bool = False
    photo_set: Path | None = None

    @model_validator(mode="after")
    def _can_be_made(self) -> Self:
        if self.rough and self.photos is None:
            raise ValueError("rough clips are made of photos; name their folder")
        if self.coded and self.photo_set is not None:
            raise ValueError("coded clips are of plants or single photos, not of photo sets")
        if sum(end - first for first, end in self.seeds or ()) > MOST_SEEDS:
            raise ValueError(f"seeds: over {MOST_SEEDS} clips")
        return self

    def all_seeds(self) -> list[int]:
        """Of the clips, in order; empty where the pool is of samples."""
        return [seed for span in self.seeds or () for seed in range(*span)]


class LossConfig(_TrainingSettings):
    """Weights of what is minimised.

    Attributes:
        charbonnier: Of the displacement's error, robust.
        squared: Of the displacement's squared error.
        mask: Of the mask's cross-entropy.
        likelihood: Of the displacement's beta-NLL, which teaches the log-variance.
    """

    charbonnier: Weight = 1
    squared: Weight = 0
    mask: Weight = 1
    likelihood: Weight = 0


class AugmentationConfig(_TrainingSettings):
    """What is done to a sample before it is shown; nothing that resamples.

    Attributes:
        symmetries: ``all`` 8 of the square, ``flips`` along both axes, ``mirror`` left and right.
        vectors: Pairs of input channels that are the (x, y) of a vector and turn with the image.
        tensors: Triples of them that are the (xx, xy, yy) of a symmetric tensor and turn with it.
        negate: Whether vectors and displacement may change sign: a gas denser than air.
        invert: Families whose brightness may be inverted.
        gain: Factor on the brightness.
    """

    symmetries: Literal["all", "flips", "mirror", "none"] = "all"
    vectors: tuple[tuple[NonNegativeInt, NonNegativeInt], ...] = ()
    tensors: tuple[tuple[NonNegativeInt, NonNegativeInt, NonNegativeInt], ...] = ()
    negate: bool = False
    invert: tuple[str, ...] = ()
    gain: tuple[Gain, Gain] = (1.0, 1.0)

    @property
    def last_plane(self) -> int:
        """The highest input channel it names; -1 for none."""
        return max(
            (plane for group in (*self.vectors, *self.tensors) for plane in group), default=-1
        )


class TrainingStage(_TrainingSettings):
    """One part of the curriculum.

    Attributes:
        name: For the journal.
        pools: How often samples are drawn from each pool, as weights.
        families: How often each family is drawn, as weights; as they lie in the pool if left out.
        steps: How many.
        learning_rate: First and last; a cosine between.
        cosine_steps: Of that cosine; a longer one than the stage is cut off.
        losses: Weights of the losses.
        least_px: Samples whose displacement stays below are left out, as they outweigh the others.
        augmentation: Instead of the training's own.
        blend: Share that the stage has in the weights it ends with; the rest is what it began
            with. In between lies what does well on old samples and new (Wortsman et al., Robust
            fine-tuning of zero-shot models, CVPR 2022).
    """

    name: str
    pools: dict[str, Weight]
    families: dict[str, Weight] | None = None
    steps: Steps
    learning_rate: tuple[LearningRate, LearningRate]
    cosine_steps: Steps | None = None
    losses: LossConfig = LossConfig()
    least_px: float = Field(default=0, ge=0)
    augmentation: AugmentationConfig | None = None
    blend: float = Field(default=1, gt=0, le=1)


class TrainConfig(_TrainingSettings):
    """A training: network, data and schedule.

    Attributes:
        name: Of the network, in its metadata.
        network: Which one.
        pools: Rendered samples by name.
        validation: The pool that is only scored.
        runs: How many simulated flows there are to render samples from.
        stages: The curriculum.
        batch: Samples a step.
        crop_px: Side of a random crop; the whole sample if left out.
        optimiser: Adam as the paper has it, or AdamW.
        weight_decay: For AdamW.
        positive_px: |w| above is plume.
        negative_px: |w| below is none; pixels in between do not count in the loss of the mask.
        augmentation: What is done to samples.
        mixed_precision: bfloat16 where it is safe.
        seed: Of weights and batches.
        log_every: Steps a line in the journal.
        checkpoint_every: Steps; at most as many are lost by a kill.
        validate_every: Steps.
        validation_samples: The most that are scored.
        initial: Weights to begin with: a checkpoint, or an exported .onnx file (fp32).
        trained_on: A line for the metadata: what data, under which licences.
    """

    name: str
    network: NetworkConfig = NetworkConfig()
    pools: dict[str, PoolConfig]
    validation: str
    runs: int = Field(default=32, ge=1, le=10**6)
    stages: tuple[TrainingStage, ...] = Field(min_length=1)
    batch: int = Field(default=8, ge=1, le=4096)
    crop_px: int | None = Field(default=None, ge=16, le=4096, multiple_of=16)
    optimiser: Literal["adam", "adamw"] = "adamw"
    weight_decay: float = Field(default=0.01, ge=0, le=1)
    positive_px: float = Field(default=0.06, gt=0)
    negative_px: float = Field(default=0.02, ge=0)
    augmentation: AugmentationConfig = AugmentationConfig()
    mixed_precision: bool = True
    seed: Seed = 0
    log_every: Steps = 100
    checkpoint_every: Steps = 1000
    validate_every: Steps = 2000
    validation_samples: int = Field(default=512, ge=1, le=10**8)
    initial: Path | None = None
    trained_on: str = ""

    @model_validator(mode="after")
    def _fits_together(self) -> Self:
        named = {name for stage in self.stages for name in stage.pools} | {self.validation}
        for name in sorted(named - self.pools.keys()):
            raise ValueError(f"pools: {name} is used and not named there")
        for name, pool in self.pools.items():
            if any(end <= first for first, end in pool.seeds or ()):
                raise ValueError(f"pools: {name}: seeds are ranges (first, after last)")
        for stage in self.stages:
            for weights in (stage.pools, stage.families or {"": 1.0}):
                if not any(weights.values()):
                    raise ValueError(f"stage {stage.name}: one of the weights must be above 0")
            losses = stage.losses
            if self.network.kind == "paper" and (losses.mask or losses.likelihood):
                raise ValueError(f"stage {stage.name}: the paper's network has displacement alone")
        for augmentation in (self.augmentation, *(stage.augmentation for stage in self.stages)):
            if augmentation and augmentation.last_plane >= self.network.channels:
                raise ValueError(
                    f"augmentation: there is no channel {augmentation.last_plane}, "
                    f"the network has {self.network.channels} (counted from 0)"
                )
        if self.negative_px > self.positive_px:
            raise ValueError("negative_px lies above positive_px")
        return self

    @classmethod
    def load(cls, path: Path, data: Path | None = None) -> Self:
        """Reads a YAML file.

        Args:
            path: The file.
            data: Where its folders of samples are; where the file is if left out.

        Raises:
            BadInputError: It cannot be read, or a setting is unknown, missing or out of range.
        """
        content = read_yaml(path)
        try:
            config = cls.model_validate(content)
        except ValidationError as error:
            raise BadInputError(f"{path}: {first_complaint(error)}") from error
        return config._resolve_paths(path.parent if data is None else data, path.parent)

    def _resolve_paths(self, data: Path, here: Path) -> Self:
        pools = {
            name: pool.model_copy(
                update={
                    "folder": data / pool.folder,
                    "photos": None if pool.photos is None else data / pool.photos,
                    "photo_set": None if pool.photo_set is None else data / pool.photo_set,
                    "recipe": None if pool.recipe is None else here / pool.recipe,
                    "measured": None if pool.measured is None else data / pool.measured,
                }
            )
            for name, pool in self.pools.items()
        }
        initial = None if self.initial is None else here / self.initial
        return self.model_copy(update={"pools": pools, "initial": initial})

    @property
    def steps(self) -> int:
        """Of all stages together."""
        return sum(stage.steps for stage in self.stages)

    def stage_starts(self) -> Iterator[tuple[int, TrainingStage]]:
        """Every stage with its first step."""
        first = 0
        for stage in self.stages:
            yield first, stage
            first += stage.steps

    def weights_digest(self, step: int) -> str:
        """Names the weights after `step` steps.

        Two configs have the same digest if they lead to the same weights there: stages to come,
        folders' places and how often something is written down do not count.
        """
        plain = self.model_dump(mode="json", exclude=set(_NO_EFFECT), exclude_defaults=True)
        plain["stages"] = [
            stage.model_dump(mode="json", exclude_defaults=True)
            for first, stage in self.stage_starts()
            if first < max(step, 1)
        ]
        pools = {
            name: self.pools[name]
            for first, stage in self.stage_starts()
            if first < max(step, 1)
            for name in stage.pools
        }
        plain["samples"] = {name: pool.samples for name, pool in pools.items()}
        if seeds := {name: pool.seeds for name, pool in pools.items() if pool.seeds}:
            plain["seeds"] = seeds
        if leaks := {name: pool.leaks for name, pool in pools.items() if pool.leaks != "nozzle"}:
            plain["leaks"] = leaks
        if rough := sorted(name for name, pool in pools.items() if pool.rough):
            plain["rough"] = rough
        if coded := sorted(name for name, pool in pools.items() if pool.coded):
            plain["coded"] = coded
        if sets := {name: pool.photo_set.name for name, pool in pools.items() if pool.photo_set}:
            plain["photo_sets"] = sets
        return hashlib.sha256(json.dumps(plain, sort_keys=True).encode()).hexdigest()[:16]

    def to_plain(self) -> dict[str, Any]:
        """The settings as JSON and YAML know them."""
        plain: dict[str, Any] = self.model_dump(mode="json")
        return plain


_NO_EFFECT = (
    "name",
    "pools",
    "validation",
    "runs",
    "stages",
    "log_every",
    "checkpoint_every",
    "validate_every",
    "validation_samples",
    "trained_on",
)
