"""The shaking of a camera at rest, measured and taken out of its frames.

Each frame moves by a translation, a rotation, a zoom and a shear (an affine map) and, as cameras
read row after row, by a shift that varies slowly from row to row. What only part of the image
does is no motion of the camera, unless it follows that motion, as what stands near does.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self, overload

import cv2
import numpy as np
from scipy.ndimage import gaussian_filter1d

from detect.differential import LeastSquaresWindow
from detect.fluctuation import NOISE, WINDOW_PX, relative_tone
from detect.warp import blur, gradients, pixel_grid, sample
from geometry.arrays import FloatArray, FloatMap, GreyImage

SIDE_PX = 320
"""Width at which the motion is measured, px; chosen by hand."""
THINNING = 4
"""Every so many pixels, each way, enter the fit."""
STRONG_TEXTURE = 400.0
"""Squared gradient above which texture counts no more, (grey levels a px)^2; chosen by hand."""
PASSES, FITS = 4, 6
"""Times that the frames are moved and compared anew, and iterations of each robust fit."""
OUTLYING = 1.5
"""Residual that halves the weight of a pixel, in median residuals; chosen by hand."""
ROW_SHARE = 1 / 12
"""Standard deviation of the blur of the rows' shifts, over the height; chosen by hand."""
MOST_MODES, FRAMES_A_MODE = 6, 6
"""Independent motions of the camera that parallax is sought of, and frames that each needs: chance
explains one part in so many of what does not follow them; chosen by hand."""
SHARE_PX = 1.0
"""Standard deviation of the blur of the parallax, px of the coarse grid; chosen by hand."""
SETTLED_PX, INVISIBLE_PX = 0.01, 0.02
"""A change of the fit that ends it, and a motion that is left in, px of `SIDE_PX`; by hand."""


@dataclass(frozen=True, kw_only=True)
class Shaking:
    """How the image of each of T frames moved.

    Attributes:
        fields_px: (T, 2, h, w) along x and y, on a coarse grid, px of the width `SIDE_PX`.
    """

    fields_px: FloatMap

    @classmethod
    def measure(cls, images: Sequence[GreyImage]) -> Self:
        """Measures T frames, (H, W) uint8 each, against the mean of all."""
        small = [shrink(image) for image in images]
        height, width = small[0].shape
        total = np.zeros((len(small), 2, -(-height // THINNING), -(-width // THINNING)), np.float32)
        moved: list[np.ndarray] = list(small)
        reference = relative_tone(small[len(small) // 2])
        for _ in range(PASSES):
            tones = [relative_tone(image) for image in moved]
            slopes = gradients(reference)
            window = LeastSquaresWindow(*slopes, WINDOW_PX, NOISE)
            weight = blur(slopes[0] ** 2 + slopes[1] ** 2, WINDOW_PX)[::THINNING, ::THINNING]
            weight = np.asarray(np.minimum(weight, STRONG_TEXTURE) + 1e-3, dtype=np.float32)
            change = np.stack([_fit_motion(window, tone - reference, weight) for tone in tones])
            total += change
            moved = [_take_out(image, field) for image, field in zip(small, total, strict=True)]
            if np.abs(change).max() < SETTLED_PX:
                break
            tones = [relative_tone(image) for image in moved]
            reference = np.asarray(np.mean(tones, axis=0), dtype=np.float32)
        window = LeastSquaresWindow(*gradients(reference), WINDOW_PX, NOISE)
        planes = [window.shift_planes(relative_tone(image) - reference) for image in moved]
        left = np.stack(planes)[..., ::THINNING, ::THINNING]
        return cls(fields_px=total + _parallax(total, left))

    @property
    def rms_px(self) -> float:
        """Root mean square of the motion over frames and pixels, px of the width `SIDE_PX`."""
        about_mean = self.fields_px - self.fields_px.mean(axis=0)
        return float(np.sqrt((about_mean**2).sum(axis=1).mean()))

    def take_out(self, image: GreyImage, frame: int) -> GreyImage:
        """The image of that frame, of any size, as the camera would have taken it at rest."""
        moved = _take_out(image, self.fields_px[frame])
        return np.asarray(np.rint(moved), dtype=np.uint8)


class SteadyImages(Sequence[GreyImage]):
    """Frames by a camera at rest without its shaking, which is measured when first needed.

    Args:
        images: The frames.
        shaking: Theirs, where it is known.
    """

    def __init__(self, images: Sequence[GreyImage], shaking: Shaking | None = None) -> None:
        self._images = images
        self._measured = shaking

    @property
    def shaking(self) -> Shaking:
        """How the camera shook."""
        if self._measured is None:
            self._measured = Shaking.measure(self._images)
        return self._measured

    @property
    def shaking_px(self) -> float:
        """Root mean square of it, px of the frames."""
        width: int = self._images[0].shape[1]
        return self.shaking.rms_px * width / min(width, SIDE_PX)

    def __len__(self) -> int:
        return len(self._images)

    @overload
    def __getitem__(self, i: int) -> GreyImage: ...
    @overload
    def __getitem__(self, i: slice) -> "SteadyImages": ...
    def __getitem__(self, i: int | slice) -> "GreyImage | SteadyImages":
        if isinstance(i, slice):
            part = Shaking(fields_px=self.shaking.fields_px[i])
            return SteadyImages(self._images[i], part)
        return self.shaking.take_out(self._images[i], i)


def shrink(image: GreyImage) -> GreyImage:
    """The image at most `SIDE_PX` wide."""
    scale = min(1.0, SIDE_PX / image.shape[1])
    small = cv2.resize(image, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
    return np.asarray(small, dtype=np.uint8)


def _fit_motion(window: LeastSquaresWindow, difference: FloatMap, weight: FloatMap) -> FloatMap:
    """(2, h, w) the motion that most of the image shares, on the coarse grid."""
    planes = window.shift_planes(difference)
    shift = np.stack([plane[::THINNING, ::THINNING] for plane in planes], axis=-1).astype(float)
    height, width = weight.shape
    place = pixel_grid(weight.shape) / width - 0.5
    design = np.column_stack([np.ones(height * width), place.reshape(-1, 2)])
    flat, prior = shift.reshape(-1, 2), weight.ravel()
    trust = prior.astype(float)
    for _ in range(FITS):
        weighted = design * trust[:, None]
        fit = np.linalg.solve(weighted.T @ design, weighted.T @ flat)
        left = flat - design @ fit
        size = np.linalg.norm(left, axis=1)
        trust = prior / (1 + (size / (OUTLYING * np.median(size) + 1e-4)) ** 2)
    rows = _mean_of_rows(left.reshape(height, width, 2), trust.reshape(height, width))
    motion = (design @ fit).reshape(height, width, 2) + rows[:, None]
    return np.moveaxis(motion, -1, 0).astype(np.float32)


def _parallax(motion: FloatMap, left: FloatMap) -> FloatMap:
    """(T, 2, h, w) what of the displacements that are left moves with the camera.

    What stands nearer or further than most moves by another share of the camera's motion; air does
    not follow it.

    Args:
        motion: (T, 2, h, w) that most of the image shares.
        left: (T, 2, h, w) displacements without it.
    """
    count = len(motion)
    rows = (motion - motion.mean(axis=0)).reshape(count, -1)
    modes, sizes, _ = np.linalg.svd(rows, full_matrices=False)
    visible = sizes / np.sqrt(rows.size / 2) > INVISIBLE_PX
    most = min(MOST_MODES, count // FRAMES_A_MODE)
    used = modes[:, :most][:, visible[:most]]
    parallax = np.zeros_like(motion)
    for mode in used.T:
        share = np.einsum("t,tchw->chw", mode, left)
        smooth = np.stack([blur(plane, SHARE_PX) for plane in share])
        parallax += mode[:, None, None, None] * smooth
    return parallax


def _mean_of_rows(left: FloatMap, trust: FloatArray) -> FloatArray:
    """(h, 2) weighted mean of each row, smooth from row to row."""
    sigma = max(1.0, ROW_SHARE * len(trust))
    sums = np.column_stack([(left * trust[..., None]).sum(axis=1), trust.sum(axis=1)])
    smooth = gaussian_filter1d(sums, sigma, axis=0)
    return np.asarray(smooth[:, :2] / (smooth[:, 2:] + 1e-6))


def _take_out(image: np.ndarray, field: FloatMap) -> np.ndarray:
    if np.abs(field).max() < INVISIBLE_PX:
        return image
    height, width = image.shape
    scale = width / min(width, SIDE_PX)
    planes = [cv2.resize(plane, (width, height)) for plane in field]
    moved = sample(image, pixel_grid(image.shape) + scale * np.stack(planes, axis=-1))
    return np.clip(moved, 0, 255)
