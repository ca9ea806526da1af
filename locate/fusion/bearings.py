"""A camera that stood still: directions to plumes, no positions."""

from collections.abc import Sequence

import cv2
import numpy as np

from detect.detection import Detection
from geometry.arrays import FloatMap
from geometry.camera import Camera
from locate.fusion.null import NULL_DRAWS, SMALLEST_SHIFT, NullLevel
from locate.fusion.views import FUSION_WIDTH_PX, correlation_area
from locate.plume import Bearing

FALSE_ALARM = 0.01
EVIDENT_NATS = 0.25
SMOOTHING_PX = 1.5
BASE_SHARE = 0.1
BASE_SIGMA_PX = 2.0


def find_bearings(
    detections: Sequence[Detection], camera: Camera, *, seed: int = 0
) -> tuple[Bearing, ...]:
    """Regions of the mean evidence that chance does not make, and the level they must pass.

    Args:
        detections: Of frames by one camera at rest.
        camera: The pinhole that took them.
        seed: Of the random shifts of the null.

    Returns:
        The bearings, strongest first.
    """
    factor = min(1.0, FUSION_WIDTH_PX / camera.width)
    small = camera.scaled(factor)
    size = (small.width, small.height)
    llr = np.stack([cv2.resize(d.llr, size, interpolation=cv2.INTER_AREA) for d in detections])
    looks = correlation_area(llr)
    rng = np.random.default_rng(seed)
    null = NullLevel.fitted([_shuffled_strongest(llr, looks, rng) for _ in range(NULL_DRAWS)])
    found = []
    for mask, nats in _regions(llr, looks):
        false_alarm = null.false_alarm(nats)
        if false_alarm <= FALSE_ALARM:
            found.append(_bearing(mask, nats, false_alarm, detections, small))
    found.sort(key=lambda bearing: -bearing.evidence_nats)
    return tuple(found)


def _shuffled_strongest(llr: FloatMap, looks: float, rng: np.random.Generator) -> float:
    width = llr.shape[2]
    shares = rng.uniform(SMALLEST_SHIFT, 1 - SMALLEST_SHIFT, len(llr))
    rolled = [np.roll(m, round(s * width), axis=1) for m, s in zip(llr, shares, strict=True)]
    return max((nats for _, nats in _regions(np.stack(rolled), looks)), default=0.0)


def _regions(llr: FloatMap, looks: float) -> list[tuple[np.ndarray, float]]:
    """Connected regions of positive mean evidence: mask and nats of each."""
    mean = cv2.GaussianBlur(llr.mean(axis=0), (0, 0), SMOOTHING_PX)
    count, labels = cv2.connectedComponents((mean > EVIDENT_NATS).astype(np.uint8))
    total = llr.sum(axis=0)
    masks = [labels == k for k in range(1, count)]
    return [(mask, float(total[mask].sum()) / looks) for mask in masks]


def _bearing(
    mask: np.ndarray,
    nats: float,
    false_alarm: float,
    detections: Sequence[Detection],
    camera: Camera,
) -> Bearing:
    rows, columns = np.nonzero(mask)
    low = rows >= np.quantile(rows, 1 - BASE_SHARE)
    base = np.array([columns[low].mean(), rows[low].max()])
    sigma_px = np.hypot(columns[low].std(), BASE_SIGMA_PX)
    wide = cv2.resize(mask.astype(np.uint8), detections[0].llr.shape[::-1]) > 0
    sizes = [np.linalg.norm(d.displacement[wide], axis=-1).mean() for d in detections]
    return Bearing(
        direction_in_cam=camera.rays(base),
        sigma_rad=float(sigma_px / camera.focal_px),
        evidence_nats=nats,
        probability=1 - false_alarm,
        displacement_px=float(np.mean(sizes)),
    )
