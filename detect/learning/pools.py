"""Training samples in memory."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from detect.learning.clips import KINDS, TrainingClip, clip_path, list_clips
from detect.learning.config import PoolConfig, TrainConfig
from detect.synthesis.dataset import HalfArray, shards_in
from detect.synthesis.recipe import SAMPLE_FAMILIES
from geometry.arrays import BoolArray, FloatMap
from geometry.errors import BadInputError


@dataclass(frozen=True, kw_only=True)
class SamplePool:
    """N samples of one size.

    Attributes:
        images: (N, H, W, C); uint8 of 255, or features as they are.
        displacements: (N, H, W, 2) float16, px.
        families: (N,) index into `family_names`.
        family_names: What kinds of sample there are.
        own_limits_px: (N, 2) above which |w| a pixel is plume and below which it is none, where
            samples say so themselves.
    """

    images: NDArray[np.uint8] | HalfArray
    displacements: HalfArray
    families: NDArray[np.uint8]
    family_names: tuple[str, ...]
    own_limits_px: FloatMap | None = None

    @classmethod
    def load(cls, config: PoolConfig) -> Self:
        """The samples of a rendered folder, or the frames of its clips.

        A sample of 128 px takes 82 kB, a training clip of 8 frames of 320 x 240 px 19 MB.

        Raises:
            BadInputError: The folder holds no samples, too few, or a broken file.
        """
        if config.seeds is not None:
            paths = [clip_path(config.folder, seed) for seed in config.all_seeds()]
            return cls._of_clips(paths)
        if paths := list_clips(config.folder):
            return cls._of_clips(paths)
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

    @classmethod
    def _of_clips(cls, paths: Sequence[Path]) -> Self:
        clips = [TrainingClip.load(path) for path in paths]
        sizes = {clip.inputs.shape[1:] for clip in clips}
        if len(sizes) > 1:
            raise BadInputError(f"{paths[0].parent}: clips of several sizes; make pools of them")
        counts = [len(clip) for clip in clips]
        kinds = [clip.kind for clip in clips]
        limits_px = np.array([clip.limits_px for clip in clips], np.float32)
        inputs = np.empty((sum(counts), *sizes.pop()), np.float16)
        displacements = np.empty((len(inputs), *inputs.shape[2:], 2), np.float16)
        end = len(inputs)
        while clips:  # freed one by one, so that memory holds them once
            clip = clips.pop()
            rows = slice(end - len(clip), end)
            inputs[rows], displacements[rows] = clip.inputs, clip.visible_displacements()
            end = rows.start
        return cls(
            images=np.moveaxis(inputs, 1, -1),
            displacements=displacements,
            families=np.repeat(kinds, counts).astype(np.uint8),
            family_names=KINDS,
            own_limits_px=np.repeat(limits_px, counts, axis=0),
        )

    def __len__(self) -> int:
        return len(self.images)

    def limits_px(self, indices: ArrayLike, config: TrainConfig) -> FloatMap:
        """(M, 2) of samples: |w| above the first is plume, below the second none."""
        if self.own_limits_px is not None:
            return np.asarray(self.own_limits_px[np.asarray(indices)])
        limits_px = (config.positive_px, config.negative_px)
        return np.full((np.size(indices), 2), limits_px, np.float32)

    def group_samples(
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
            is_one = (
                self.families == self._family_index(name)
                if name
                else np.ones(len(self), dtype=bool)
            )
            groups.append((np.flatnonzero(is_one & among), weight))
        groups = [(members, weight) for members, weight in groups if len(members) and weight > 0]
        if not groups:
            raise BadInputError(f"no sample of {', '.join(weights) or 'any kind'} in a pool")
        shares = np.array([weight for _, weight in groups])
        return [members for members, _ in groups], shares / shares.sum()

    def select_reaching(self, least_px: float) -> BoolArray:
        """(N,) whether either component of a sample's displacement reaches `least_px` anywhere."""
        if not least_px:
            return np.ones(len(self), dtype=bool)
        return np.array([np.abs(each).max() >= least_px for each in self.displacements])

    def _family_index(self, family: str) -> int:
        return self.family_names.index(family) if family in self.family_names else -1


def as_input(image: np.ndarray) -> FloatMap:
    """(..., H, W, C) of a pool as (..., C, H, W) for a network; grey levels become [0, 1]."""
    planes = planes_first(image)
    return planes / np.float32(255) if image.dtype == np.uint8 else planes


def planes_first(array: np.ndarray) -> FloatMap:
    """(..., H, W, C) as (..., C, H, W) float32."""
    return np.ascontiguousarray(np.moveaxis(array, -1, -3), dtype=np.float32)
