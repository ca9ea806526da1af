"""Moving air before a camera at rest, separated from noise by its temporal coherence.

Noise is new in every frame, and moving air carries its pattern from one frame to the next: the
covariance of a pixel's displacement with that in the next frame is zero for noise, however strong,
and positive for air. How large chance makes it is measured on the same frames in random order.
Video codecs carry noise on as well: then hardly any pixel is as low as chance makes it.

Branches and flags move too, but oscillate: the autocorrelation of a damped oscillation falls to
-exp(-pi zeta) half a period later, -0.5 to -0.9 for the damping ratios zeta of trees, where that of
turbulence fades.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np

from detect.differential import LeastSquaresWindow
from detect.warp import blur, gradients
from geometry.arrays import BoolArray, FloatArray, FloatMap, GreyImage

PRESMOOTHING_PX, WINDOW_PX, NOISE = 0.7, 2.0, 1.4
"""Blur of the frames and window of the displacement, px; noise of the tones, grey levels; chosen
by hand."""
SHADING_PX, DARKEST = 12.0, 4.0
"""Standard deviation of the surroundings that brightness is taken relative to, px, and what is
added to it, grey levels; chosen by hand."""
GREY_LEVELS = 64.0
"""What a tone that is e times as bright as its surroundings counts as; chosen by hand."""
MOST_PX = 3.0
"""Displacements are clipped to this; chosen by hand."""
POOL_PX, CHANCE_POOL_PX = 4.0, 8.0
"""Standard deviation of the blur of covariances, and of their variance by chance; by hand."""
DRAWS, MOST_LAG, LEAST_PX2 = 12, 25, 1e-8
"""Random orders, longest lag in frames, and what keeps ratios finite; chosen by hand."""
LOW_SHARE, CALM_SHARE = 0.1, 0.55
"""Quantile of the covariance by chance, and share of so low pixels, of that by chance, below which
noise itself is coherent; chosen by hand."""
CLEAR, FEWEST_CLEAR, OSCILLATING = 0.5, 50, -0.35
"""Autocorrelation at one frame of pixels that show more than noise, how many are needed, and the
lowest later one of what oscillates: between turbulence (0) and branches (-0.5); by hand."""


@dataclass(frozen=True, kw_only=True)
class Fluctuation:
    """What is coherent from frame to frame.

    Attributes:
        covariance_px2: (H, W) of the displacement with that in the next frame, both components.
        sigmas: (H, W) by how many standard deviations it is above zero.
        shuffled_sigmas: (D, H, W) the same of the frames in random orders.
        next_autocorrelation: (H, W) the covariance as a share of the variance, noise and all.
        lowest_autocorrelation: (H, W) the lowest of all later ones.
    """

    covariance_px2: FloatMap
    sigmas: FloatMap
    shuffled_sigmas: FloatMap
    next_autocorrelation: FloatMap
    lowest_autocorrelation: FloatMap

    @classmethod
    def measure(cls, images: Sequence[GreyImage], rng: np.random.Generator) -> Self:
        """Measures T frames, (H, W) uint8 each, that follow each other closely."""
        shifts = shifts_px(images)
        covariance = autocovariance(shifts, 1)
        drawn = np.stack(
            [autocovariance(shifts[rng.permutation(len(shifts))], 1) for _ in range(DRAWS)]
        )
        variance = np.maximum(autocovariance(shifts, 0), LEAST_PX2)
        later = range(2, min(MOST_LAG, len(shifts) // 2) + 1)
        lowest = np.min([autocovariance(shifts, lag) for lag in later], axis=0)
        deviation = np.sqrt(blur((drawn**2).mean(axis=0), CHANCE_POOL_PX))
        deviation = np.maximum(deviation, LEAST_PX2)
        return cls(
            covariance_px2=covariance,
            sigmas=np.asarray(covariance / deviation),
            shuffled_sigmas=np.asarray(drawn / deviation),
            next_autocorrelation=np.asarray(covariance / variance),
            lowest_autocorrelation=np.asarray(lowest / variance),
        )

    @property
    def is_everywhere(self) -> bool:
        """Whether even calm pixels are coherent, as in compressed video, whose noise is."""
        low = np.quantile(self.shuffled_sigmas, LOW_SHARE)
        return bool(low < 0 and (self.sigmas < low).mean() < CALM_SHARE * LOW_SHARE)

    def oscillates(self, where: BoolArray) -> bool:
        """Whether what moves in these pixels of (H, W) swings; not where noise hides it."""
        clear = where & (self.next_autocorrelation > CLEAR)
        if clear.sum() < FEWEST_CLEAR:
            return False
        return bool(np.median(self.lowest_autocorrelation[clear]) < OSCILLATING)


def shifts_px(images: Sequence[GreyImage]) -> FloatMap:
    """(T, 2, H, W) displacement of each frame from the mean of all, its own mean over time zero.

    Brightness is taken relative to that of the surroundings, and contrast to that of the frame, so
    that light may change; shifts of the whole image are taken out. Patterns finer than the window
    of `WINDOW_PX` are lessened.
    """
    tones = [relative_tone(image) for image in images]
    usual = np.mean([tone.std() for tone in tones])
    tones = [tone * (usual / max(float(tone.std()), 1e-6)) for tone in tones]
    mean = np.mean(tones, axis=0)
    window = LeastSquaresWindow(*gradients(mean), WINDOW_PX, NOISE)
    shifts = np.stack([window.shift_planes(tone - mean) for tone in tones])
    shifts -= np.median(shifts, axis=(2, 3), keepdims=True)
    shifts = np.clip(shifts, -MOST_PX, MOST_PX)
    return np.asarray(shifts - shifts.mean(axis=0))


def autocovariance(shifts: FloatMap, lag: int) -> FloatMap:
    """(H, W) mean product of (T, 2, H, W) shifts with those `lag` frames later, pooled, px^2."""
    count = len(shifts) - lag
    products = np.einsum("tchw,tchw->hw", shifts[:count], shifts[lag:]) / count
    return blur(products.astype(np.float32), POOL_PX)


def relative_tone(image: np.ndarray) -> FloatMap:
    """(H, W) logarithm of an image relative to that of its surroundings, in `GREY_LEVELS`."""
    tone = blur(np.log(image + np.float32(DARKEST)), PRESMOOTHING_PX)
    return np.asarray(GREY_LEVELS * (tone - blur(tone, SHADING_PX)))


def longest_run(times_s: FloatArray, most_s: float) -> slice:
    """The longest run of frames of which each follows within `most_s` of the one before."""
    breaks = np.flatnonzero(np.diff(times_s) > most_s) + 1
    starts, ends = np.r_[0, breaks], np.r_[breaks, len(times_s)]
    longest = int(np.argmax(ends - starts))
    return slice(int(starts[longest]), int(ends[longest]))
