"""What a training step sees; batch i follows from the seed and i alone."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from detect.learning.augmentation import augment_sample
from detect.learning.config import TrainConfig, TrainingStage
from detect.learning.pools import SamplePool, as_input, planes_first
from geometry.arrays import FloatMap
from geometry.errors import BadInputError


@dataclass(frozen=True, kw_only=True)
class TrainingBatch:
    """What one step sees.

    Attributes:
        image: (N, C, H, W).
        displacement: (N, 2, H, W) px.
        limits_px: (N, 2) |w| above the first is plume, below the second none.
    """

    image: FloatMap
    displacement: FloatMap
    limits_px: FloatMap


class StageBatches:
    """The batches of one stage."""

    def __init__(
        self, config: TrainConfig, stage: TrainingStage, pools: Mapping[str, SamplePool]
    ) -> None:
        self._config = config
        self._pools = [pools[name] for name in stage.pools]
        weights = np.array(list(stage.pools.values()))
        self._weights = weights / weights.sum()
        self._augmentation = stage.augmentation or config.augmentation
        self._groups = [
            pool.group_samples(stage.families, pool.select_reaching(stage.least_px))
            for pool in self._pools
        ]

    def __getitem__(self, step: int) -> TrainingBatch:
        """The batch of a step of the whole training."""
        random = np.random.default_rng((self._config.seed, step))
        drawn = [self._draw_sample(random) for _ in range(self._config.batch)]
        images, displacements, limits_px = zip(*drawn, strict=True)
        return TrainingBatch(
            image=np.stack(images),
            displacement=np.stack(displacements),
            limits_px=np.concatenate(limits_px),
        )

    def _draw_sample(self, random: np.random.Generator) -> tuple[FloatMap, FloatMap, FloatMap]:
        which = random.choice(len(self._pools), p=self._weights)
        pool, (groups, weights) = self._pools[which], self._groups[which]
        group = groups[random.choice(len(groups), p=weights)]
        index = group[random.integers(len(group))]
        window = self._draw_window(pool, random)
        image = as_input(pool.images[index][window])
        displacement = planes_first(pool.displacements[index][window])
        family = pool.family_names[pool.families[index]]
        limits_px = pool.limits_px([index], self._config)
        return *augment_sample(image, displacement, family, self._augmentation, random), limits_px

    def _draw_window(self, pool: SamplePool, random: np.random.Generator) -> tuple[slice, slice]:
        height, width = pool.displacements.shape[1:3]
        side = self._config.crop_px
        if side is None:
            return slice(None), slice(None)
        if side > min(height, width):
            raise BadInputError(f"crop_px: {side} is more than the samples' {width} x {height} px")
        y, x = random.integers(height - side + 1), random.integers(width - side + 1)
        return slice(y, y + side), slice(x, x + side)
