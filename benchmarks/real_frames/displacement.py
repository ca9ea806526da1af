"""How much of a plume's true displacement was measured, and where it was lost."""

from dataclasses import dataclass

import cv2
import numpy as np

from detect.information import DisplacementInformation
from detect.registered.information import COMMON_SHARE
from detect.registered.separation import TINY
from detect.warp import gradients, sample, structure_tensor
from geometry.arrays import BoolArray, FloatMap, GreyImage
from geometry.camera import Camera
from locate.simulation.plume_field import visible_percentile

INSIDE_SHARE = 0.3
"""Of the frame's 95th percentile of |w|: above it a pixel is inside the plume."""
FEWEST = 30
"""Pixels of which a share is stated, at least."""
TEXTURE_SIGMA_PX = 2.0
EDGE_SIDE_PX = 5
THIRDS = ("texture", "size", "edge")
SHIFTS = 250
ASIDE_SHARE, UP_SHARE = (0.06, 0.5), 1 / 6
"""How far a plume's shape is moved aside, in widths, and up or down, in heights, to where none
is."""
AS_MUCH = 0.25
"""Share of the precision at the plume that a place elsewhere must have."""


@dataclass(frozen=True, kw_only=True)
class FrameRatios:
    """Measured over true displacement of one frame; NaN where too little was measured.

    Attributes:
        inside: Inside the plume.
        thirds: The same of the lowest, middle and highest third of those pixels, by each of
            `THIRDS`: how much detail the frame has there, |w|, and the step of depth.
        mean_px: Mean true |w| inside.
        informed: As `informed_over_true`.
        signal: As `signal_over_noise`.
    """

    inside: float
    thirds: dict[str, tuple[float, float, float]]
    mean_px: float
    informed: float = float("nan")
    signal: float = float("nan")


def true_in_undistorted(truth: FloatMap, camera: Camera) -> FloatMap:
    """(H, W, 2) the displacement in px of the undistorted frame that a detector is shown.

    Args:
        truth: (H', W', 2) px of the frame as it was rendered, perhaps larger than the run's.
        camera: Of the run's frames.
    """
    places = camera.undistortion_map()
    factor = np.array([truth.shape[1] / camera.width, truth.shape[0] / camera.height])
    where = (places + 0.5) * factor - 0.5
    read = [sample(truth[..., k], where.astype(np.float32)) for k in range(2)]
    bent = places + np.stack(read, axis=-1) / factor
    straight = camera.undistorted()
    away = straight.project(camera.rays(bent)) - straight.project(camera.rays(places))
    return np.asarray(away, dtype=np.float32)


def measured_over_true(measured: FloatMap, truth: FloatMap, pixels: BoolArray) -> float:
    """Slope of the measured displacement (H, W, 2) against the true one over the pixels.

    Noise that does not know of the plume leaves it as it is.
    """
    if pixels.sum() < FEWEST:
        return float("nan")
    true = truth[pixels].astype(float)
    return float((measured[pixels] * true).sum() / (true**2).sum())


def informed_over_true(information: DisplacementInformation, truth: FloatMap) -> float:
    """Size of the true displacement by the normal equations; 1 where nothing is lost.

    What surroundings share is taken out of both.

    Args:
        information: (h, w) of a frame.
        truth: (H, W, 2) px.
    """
    height, width = information.matrix.shape[:2]
    coarse = cv2.resize(truth, (width, height), interpolation=cv2.INTER_AREA)
    exact = DisplacementInformation(
        vector=information.times(coarse), matrix=information.matrix
    ).without_local_mean(COMMON_SHARE * width)
    variance = float((coarse * exact.vector).sum())
    return float((coarse * information.vector).sum()) / variance if variance > 0 else float("nan")


def signal_over_noise(information: DisplacementInformation, truth: FloatMap) -> float:
    """What a frame says for a plume of known displacement, against its scatter elsewhere.

    Args:
        information: (h, w) of a frame.
        truth: (H, W, 2) px.
    """
    height, width = information.matrix.shape[:2]
    coarse = cv2.resize(truth, (width, height), interpolation=cv2.INTER_AREA)
    rng = np.random.default_rng(0)
    aside = rng.uniform(*ASIDE_SHARE, SHIFTS) * rng.choice([-1, 1], SHIFTS) * width
    up = rng.uniform(-UP_SHARE, UP_SHARE, SHIFTS) * height
    moved = [_moved(coarse, int(x), int(y)) for x, y in zip(aside, up, strict=True)]
    precision = np.array([(w * information.times(w)).sum() for w in (coarse, *moved)])
    score = np.array([(w * information.vector).sum() for w in (coarse, *moved)])
    sigmas = score / np.sqrt(np.maximum(precision, TINY))
    elsewhere = precision[1:] > AS_MUCH * precision[0]
    if precision[0] <= 0 or elsewhere.sum() < FEWEST:
        return float("nan")
    return float(sigmas[0] / sigmas[1:][elsewhere].std())


def _moved(maps: FloatMap, right: int, down: int) -> FloatMap:
    """(H, W, 2) maps moved by whole pixels; what comes in from outside is 0."""
    matrix = np.array([[1.0, 0, right], [0, 1, down]])
    return np.asarray(cv2.warpAffine(maps, matrix, maps.shape[1::-1], flags=cv2.INTER_NEAREST))


def frame_ratios(
    measured: FloatMap,
    known: BoolArray,
    truth: FloatMap,
    image: GreyImage,
    inverse_depth: FloatMap | None,
) -> FrameRatios:
    """The ratios of a frame.

    Args:
        measured: (H, W, 2) px.
        known: (H, W) where anything was measured.
        truth: (H, W, 2) px.
        image: (H, W) the frame.
        inverse_depth: (H, W) of the background as measured; None where it was not.
    """
    size = np.linalg.norm(truth, axis=-1)
    plume = size > max(INSIDE_SHARE * visible_percentile(truth), 1e-6)
    inside = plume & known
    along_x, _, along_y = structure_tensor(*gradients(image), TEXTURE_SIGMA_PX)
    by = {"texture": along_x + along_y, "size": size}
    if inverse_depth is not None:
        by["edge"] = depth_step(inverse_depth)
    nothing = (float("nan"),) * 3
    return FrameRatios(
        inside=measured_over_true(measured, truth, inside),
        thirds={
            name: by_third(measured, truth, inside, by[name]) if name in by else nothing
            for name in THIRDS
        },
        mean_px=float(size[plume].mean()) if plume.any() else float("nan"),
    )


def by_third(
    measured: FloatMap, truth: FloatMap, inside: BoolArray, value: FloatMap
) -> tuple[float, float, float]:
    """Measured over true in the lowest, middle and highest third of a value inside the plume."""
    known = inside & np.isfinite(value)
    if not known.any():
        return (float("nan"),) * 3
    first, second = np.quantile(value[known], [1 / 3, 2 / 3])
    low, high = known & (value <= first), known & (value > second)
    middle = known & ~low & ~high
    one, two, three = (measured_over_true(measured, truth, part) for part in (low, middle, high))
    return one, two, three


def depth_step(inverse_depth: FloatMap) -> FloatMap:
    """(H, W) the largest step of inverse depth around a pixel; NaN where it is unknown."""
    along_x, along_y = gradients(inverse_depth.astype(np.float32))
    step = np.nan_to_num(np.hypot(along_x, along_y), nan=0.0).astype(np.float32)
    around = cv2.dilate(step, np.ones((EDGE_SIDE_PX, EDGE_SIDE_PX), np.uint8))
    return np.where(np.isfinite(inverse_depth), around, np.nan).astype(np.float32)
