"""Training samples in memory; batch i follows from the seed and i alone."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

from detect.learning.augmentation import augment
from detect.learning.config import PoolConfig, Stage, TrainConfig
from detect.synthesis.dataset import Half, shards_in
from detect.synthesis.recipe import SAMPLE_FAMILIES
from geometry.arrays import BoolArray, FloatMap
from geometry.errors import BadInputError


@dataclass(frozen=True, kw_only=True)
class Pool:
    """N samples of one size.

    Attributes:
        images: (N, H, W, C); uint8 of 255, or features as they are.
        displacements: (N, H, W, 2) float16, px.
        families: (N,) index into `family_names`.
        family_names: What kinds of sample there are.
    """

    images: NDArray[np.uint8] | Half
    displacements: Half
    families: NDArray[np.uint8]
    family_names: tuple[str, ...]

    @classmethod
    def load(cls, config: PoolConfig) -> Self:
        """The samples of a rendered folder.

        Raises:
            BadInputError: The folder holds no samples, too few, or a broken shard.
        """
        shards = []
        for shard in shards_in(config.folder):
            shards.append(shard)
            if config.samples is not None and sum(map(len, shards)) >= config.samples:
                break
        there, wanted = sum(map(len, shards)), config.samples or 1
        if there < wanted:
            raise BadInputError(f"{config.folder}: {there} of {wanted} samples; render the others")
        images = np.concatenate([shard.images for shard in shards])[: config.samples]
        return cls(
            images=images.reshape(*images.shape[:3], -1),
            displacements=np.concatenate([s.displacements for s in shards])[: config.samples],
            families=np.concatenate([shard.families for shard in shards])[: config.samples],
            family_names=SAMPLE_FAMILIES,
        )

    def __len__(self) -> int:
        return len(self.images)

    def groups(
        self, families: Mapping[str, float] | None, among: BoolArray
    ) -> tuple[list[NDArray[np.intp]], np.ndarray]:
        """Samples to draw from, and how often each group; families that are not there are left.

        Args:
            families: Weights by name; none for all samples alike.
            among: (N,) which samples count.

        Raises:
            BadInputError: No sample is left.
        """
        weights = {"": 1.0} if families is None else families
        groups = []
        for name, weight in weights.items():
            is_one = self.families == self._index(name) if name else np.ones(len(self), dtype=bool)
            groups.append((np.flatnonzero(is_one & among), weight))
        groups = [(members, weight) for members, weight in groups if len(members) and weight > 0]
        if not groups:
            raise BadInputError(f"no sample of {', '.join(weights) or 'any kind'} in a pool")
        shares = np.array([weight for _, weight in groups])
        return [members for members, _ in groups], shares / shares.sum()

    def reaching(self, least_px: float) -> BoolArray:
        """(N,) whether either component of a sample's displacement reaches `least_px` anywhere."""
        if not least_px:
            return np.ones(len(self), dtype=bool)
        return np.array([np.abs(each).max() >= least_px for each in self.displacements])

    def _index(self, family: str) -> int:
        return self.family_names.index(family) if family in self.family_names else -1


@dataclass(frozen=True, kw_only=True)
class Batch:
    """What one step sees.

    Attributes:
        image: (N, C, H, W).
        displacement: (N, 2, H, W) px.
    """

    image: FloatMap
    displacement: FloatMap


class Batches:
    """The batches of one stage."""

    def __init__(self, config: TrainConfig, stage: Stage, pools: Mapping[str, Pool]) -> None:
        self._config = config
        self._pools = [pools[name] for name in stage.pools]
        weights = np.array(list(stage.pools.values()))
        self._weights = weights / weights.sum()
        self._augmentation = stage.augmentation or config.augmentation
        self._groups = [
            pool.groups(stage.families, pool.reaching(stage.least_px)) for pool in self._pools
        ]

    def __getitem__(self, step: int) -> Batch:
        """The batch of a step of the whole training."""
        random = np.random.default_rng((self._config.seed, step))
        pairs = [self._draw(random) for _ in range(self._config.batch)]
        return Batch(
            image=np.stack([image for image, _ in pairs]),
            displacement=np.stack([displacement for _, displacement in pairs]),
        )

    def _draw(self, random: np.random.Generator) -> tuple[FloatMap, FloatMap]:
        which = random.choice(len(self._pools), p=self._weights)
        pool, (groups, weights) = self._pools[which], self._groups[which]
        group = groups[random.choice(len(groups), p=weights)]
        index = group[random.integers(len(group))]
        window = self._window(pool, random)
        image = as_input(pool.images[index][window])
        displacement = _planes_first(pool.displacements[index][window])
        family = pool.family_names[pool.families[index]]
        return augment(image, displacement, family, self._augmentation, random)

    def _window(self, pool: Pool, random: np.random.Generator) -> tuple[slice, slice]:
        height, width = pool.displacements.shape[1:3]
        side = self._config.crop_px
        if side is None:
            return slice(None), slice(None)
        if side > min(height, width):
            raise BadInputError(f"crop_px: {side} is more than the samples' {width} x {height} px")
        y, x = random.integers(height - side + 1), random.integers(width - side + 1)
        return slice(y, y + side), slice(x, x + side)


def as_input(image: np.ndarray) -> FloatMap:
    """(..., H, W, C) of a pool as (..., C, H, W) for a network; grey levels become [0, 1]."""
    planes = _planes_first(image)
    return planes / np.float32(255) if image.dtype == np.uint8 else planes


def _planes_first(array: np.ndarray) -> FloatMap:
    return np.ascontiguousarray(np.moveaxis(array, -1, -3), dtype=np.float32)
