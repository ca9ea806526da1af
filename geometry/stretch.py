"""Samples of more than 8 bits, or real numbers, in 8 bits of grey: one scale for a recording."""

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Self, TypeAlias

import numpy as np
from numpy.typing import NDArray

from geometry.arrays import FloatArray, GreyImage, GreySamples, IntArray

DeepSamples: TypeAlias = NDArray[np.uint16] | NDArray[np.float32]
Samples: TypeAlias = NDArray[np.uint8] | DeepSamples
VALUES = 1 << 16
"""Values that a sample of 16 bits can take."""
GREYS = 256
"""Values that a sample of 8 bits can take."""
FINE = VALUES // GREYS
"""Steps of a grey level that samples of 16 bits hold."""
FEWEST_BITS, MOST_BITS = 10, 16
"""Bits that a camera with 16-bit samples uses."""
TAIL = 0.001
"""Share of the samples at either end that does not decide the scale (chosen)."""
MARGIN = 0.05
"""Added at either end, over the range between the tails, for frames that were not looked at."""
WIDE = 0.5
"""Share of all values from which on the range counts as used: then it is not stretched (chosen)."""
FINEST_STEP = 0.25
"""Fewest values per grey level: where there is no contrast, noise is not made into it (chosen)."""
CLIPPED = 0.01
"""Share of the samples outside the scale from which on it no longer fits an image (chosen)."""


def as_samples(values: NDArray[Any]) -> Samples:
    """The values of an image: 8 and 16 bits as they are, all others as real numbers."""
    if values.dtype in (np.uint8, np.uint16):
        return values
    with np.errstate(over="ignore"):  # what single precision cannot hold is as good as missing
        return values.astype(np.float32)


def deep_samples(samples: Samples) -> DeepSamples | None:
    """The samples where they need a stretch; None of 8 bits."""
    if samples.dtype == np.uint8:
        return None
    if samples.dtype == np.uint16:
        return samples.astype(np.uint16, copy=False)
    return samples.astype(np.float32, copy=False)


@dataclass(frozen=True, kw_only=True)
class Stretch:
    """A linear scale from deep samples to 8 bits of grey; what lies outside is cut.

    Attributes:
        low: The value that becomes black.
        step: Values per grey level.
        frames: Number of frames it was chosen from.
        real: The samples are real numbers, not of 16 bits.
    """

    low: float
    step: float
    frames: int = 1
    real: bool = False

    @classmethod
    def choose(cls, images: Iterable[DeepSamples], *, bits: int | None = None) -> Self | None:
        """The scale of a recording, from a spread of its frames; None without any.

        Frames that use their range, or show nothing at all, keep the highest 8 of their bits.
        Others are stretched from the 0.1 to the 99.9 per cent of all their samples; 0 and the
        largest value of 16 bits, which often mark pixels without a value, do not count. Real
        numbers are always stretched; those that are not finite do not count.

        Args:
            images: (H, W) samples.
            bits: In use; by default 10, 12, 14 or 16, by the largest value.
        """
        counts = np.zeros(VALUES, dtype=np.int64)
        finite: list[FloatArray] = []
        frames = 0
        for image in images:
            frames += 1
            if image.dtype == np.uint16:
                counts += np.bincount(image.ravel(), minlength=VALUES)
            else:
                finite.append(image[np.isfinite(image)].astype(float))
        if any(map(len, finite)):
            return cls._of_real_numbers(np.concatenate(finite), frames)
        if not counts.any():
            return None
        largest = int(np.flatnonzero(counts)[-1])
        bits = bits or max(FEWEST_BITS, 2 * -(-largest.bit_length() // 2))
        first, last = _trim_tails(counts)
        if last == first or last - first >= WIDE * (1 << bits):
            return cls(low=0.0, step=float(1 << (bits - 8)), frames=frames)
        span = max((last - first) * (1 + 2 * MARGIN), FINEST_STEP * GREYS)
        return cls(low=(first + last - span) / 2, step=span / GREYS, frames=frames)

    @classmethod
    def _of_real_numbers(cls, values: FloatArray, frames: int) -> Self:
        first, last = np.quantile(values, [TAIL, 1 - TAIL])
        span = float(last - first) * (1 + 2 * MARGIN) or 1.0
        low = float(first + last - span) / 2
        return cls(low=low, step=span / GREYS, frames=frames, real=True)

    @property
    def high(self) -> float:
        """The value at which white is reached."""
        return self.low + self.step * GREYS

    @property
    def is_whole_range(self) -> bool:
        """Whether it keeps the highest 8 of 16 bits."""
        return (self.low, self.step) == (0.0, VALUES / GREYS)

    @property
    def note(self) -> str:
        """What was done, for the notes of a map."""
        if self.real:
            return (
                f"samples are real numbers: {self.low:.5g} (black) to {self.high:.5g} (white) are "
                f"shown in 8 bits of grey in every frame, chosen from {self.frames} of them"
            )
        return (
            f"samples of more than 8 bits: values from {max(self.low, 0):.0f} (black) to "
            f"{min(self.high, VALUES) - 1:.0f} (white) of {VALUES - 1} are shown in 8 bits of grey "
            f"in every frame, chosen from {self.frames} of them"
        )

    def apply(self, image: DeepSamples) -> GreyImage:
        """The (H, W) image in 8 bits; what is no number is black."""
        return in_8_bits(self.apply_finely(image))

    def apply_finely(self, image: DeepSamples) -> NDArray[np.uint16]:
        """The (H, W) image in `FINE` steps per grey level; what is no number is black."""
        if image.dtype == np.uint16:
            return np.asarray(self._fine_greys[image], dtype=np.uint16)
        values = np.floor((image.astype(float) - self.low) * FINE / self.step)
        return np.nan_to_num(values).clip(0, VALUES - 1).astype(np.uint16)

    def suits(self, samples: Samples) -> bool:
        """Whether it is for samples of this kind."""
        return samples.dtype == (np.float32 if self.real else np.uint16)

    def fits(self, image: DeepSamples) -> bool:
        """Whether next to nothing of the image lies outside the scale."""
        outside = (image < self.low) | (image >= self.high)
        return bool(outside.mean() <= CLIPPED)

    @cached_property
    def _fine_greys(self) -> NDArray[np.uint16]:
        values = np.floor((np.arange(VALUES) - self.low) * FINE / self.step)
        return np.asarray(values.clip(0, VALUES - 1), dtype=np.uint16)


def in_8_bits(samples: GreySamples) -> GreyImage:
    """The (H, W) image of whole grey levels."""
    return np.asarray(samples if samples.dtype == np.uint8 else samples // FINE, dtype=np.uint8)


def _trim_tails(counts: IntArray) -> tuple[int, int]:
    """The smallest and the largest value between the tails."""
    inner = counts.copy()
    inner[[0, -1]] = 0
    total = np.cumsum(inner if inner.any() else counts)
    first, last = np.searchsorted(total, [TAIL * total[-1], (1 - TAIL) * total[-1]])
    return int(first), int(last)
