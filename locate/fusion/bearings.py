"""A camera that stood still: directions to plumes, no positions.

Two things tell: evidence in single frames, and what lasts from one frame to the next, which shows
weaker fluctuations. Each is judged against its own chance.
"""

from collections.abc import Sequence
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from detect.detection import Detection
from detect.fluctuation import Fluctuation
from geometry.arrays import BoolArray, FloatArray, FloatMap, GreyImage
from geometry.camera import Camera
from locate.fusion.null import NULL_DRAWS, SMALLEST_SHIFT, NullLevel
from locate.fusion.views import FUSION_WIDTH_PX, correlation_area
from locate.plume import Bearing

FALSE_ALARM = 0.01
EVIDENT_NATS = 0.25
LASTING_SIGMAS, EVIDENT_SIGMAS = 2.0, 3.5
GAP_PX, BLURRED_PX = 15, 17
SMOOTHING_PX = 1.5
BASE_SHARE = 0.1
BASE_SIGMA_PX = 2.0
FEWEST_IN_A_ROW, LEAST_NATS = 24, 20.0
ONLY_STRONG = "only what single frames show is reported; weaker plumes are missed."
TOO_SLOW = f"Too few frames follow each other within a tenth of a second: {ONLY_STRONG}"
EVERYWHERE = (
    "Something lasts from frame to frame all over the image (the noise of compressed video, or "
    f"much that moves): {ONLY_STRONG}"
)


class FromRest(NamedTuple):
    """What a camera at rest shows: bearings, strongest first, and notes on what limits them."""

    bearings: tuple[Bearing, ...]
    notes: tuple[str, ...]


class _Region(NamedTuple):
    """Connected pixels that speak for a plume, what they say, and how often chance says so."""

    mask: BoolArray
    nats: float
    false_alarm: float
    displacement_px: float


def find_bearings(
    detections: Sequence[Detection],
    camera: Camera,
    *,
    in_a_row: Sequence[GreyImage] = (),
    seed: int = 0,
) -> FromRest:
    """Regions of evidence that chance does not make.

    Args:
        detections: Of frames by one camera at rest.
        camera: The pinhole that took them.
        in_a_row: Frames of it that follow each other closely; too few say nothing.
        seed: Of the random shifts and orders of the nulls.
    """
    factor = min(1.0, FUSION_WIDTH_PX / camera.width)
    small = camera.scaled(factor)
    rng = np.random.default_rng(seed)
    regions, notes = _in_time(in_a_row, small, rng)
    regions = [r._replace(displacement_px=r.displacement_px / factor) for r in regions]
    seen = np.any([region.mask for region in regions], axis=0)
    regions += [r for r in _in_frames(detections, small, rng) if not (r.mask & seen).any()]
    bearings = [_bearing(region, small) for region in regions]
    bearings.sort(key=lambda bearing: -bearing.evidence_nats)
    return FromRest(tuple(bearings), notes)


def _in_frames(
    detections: Sequence[Detection], camera: Camera, rng: np.random.Generator
) -> list[_Region]:
    """Regions of positive mean evidence."""
    size = (camera.width, camera.height)
    llr = np.stack([cv2.resize(d.llr, size, interpolation=cv2.INTER_AREA) for d in detections])
    looks = correlation_area(llr)
    null = NullLevel.fitted([_shuffled_strongest(llr, looks, rng) for _ in range(NULL_DRAWS)])
    found = []
    for mask, nats in _evident(llr, looks):
        wide = cv2.resize(mask.astype(np.uint8), detections[0].llr.shape[::-1]) > 0
        sizes = [np.linalg.norm(d.displacement[wide], axis=-1).mean() for d in detections]
        found.append(_Region(mask, nats, null.false_alarm(nats), float(np.mean(sizes))))
    return [region for region in found if region.false_alarm <= FALSE_ALARM]


def _shuffled_strongest(llr: FloatMap, looks: float, rng: np.random.Generator) -> float:
    width = llr.shape[2]
    shares = rng.uniform(SMALLEST_SHIFT, 1 - SMALLEST_SHIFT, len(llr))
    rolled = [np.roll(m, round(s * width), axis=1) for m, s in zip(llr, shares, strict=True)]
    return max((nats for _, nats in _evident(np.stack(rolled), looks)), default=0.0)


def _evident(llr: FloatMap, looks: float) -> list[tuple[BoolArray, float]]:
    """Connected regions of positive mean evidence: mask and nats of each."""
    mean = cv2.GaussianBlur(llr.mean(axis=0), (0, 0), SMOOTHING_PX)
    total = llr.sum(axis=0)
    return [(mask, float(total[mask].sum()) / looks) for mask in _connected(mean > EVIDENT_NATS)]


def _in_time(
    images: Sequence[GreyImage], camera: Camera, rng: np.random.Generator
) -> tuple[list[_Region], tuple[str, ...]]:
    """Regions whose displacement lasts from frame to frame, px of `camera`; why there are none.

    What was pooled is blurred; where it falls to half, the plume ends.
    """
    if len(images) < FEWEST_IN_A_ROW:
        return [], (TOO_SLOW,)
    size = (camera.width, camera.height)
    frames = [cv2.resize(image, size, interpolation=cv2.INTER_AREA) for image in images]
    measured = Fluctuation.of(frames, rng)
    if measured.is_everywhere:
        return [], (EVERYWHERE,)
    looks = correlation_area(measured.by_chance)
    strongest = [
        max((nats for _, nats in _lasting(sigmas, looks)), default=0.0)
        for sigmas in measured.by_chance
    ]
    null = NullLevel.fitted(strongest)
    sharp = measured.sigmas > cv2.dilate(measured.sigmas, _disc(BLURRED_PX)) / 2
    found = []
    for region, nats in _lasting(measured.sigmas, looks):
        mask = region & sharp
        displacement_px = np.sqrt(max(0.0, float(measured.covariance_px2[mask].mean())))
        if nats >= LEAST_NATS:
            found.append(_Region(mask, nats, null.false_alarm(nats), displacement_px))
    return [region for region in found if region.false_alarm <= FALSE_ALARM], ()


def _lasting(sigmas: FloatMap, looks: float) -> list[tuple[BoolArray, float]]:
    """Regions above zero, somewhere clearly: mask and nats of each.

    What stands apart by less than `GAP_PX` is one: a plume shows where its background does.
    """
    lasting = sigmas > LASTING_SIGMAS
    joined = cv2.morphologyEx(lasting.astype(np.uint8), cv2.MORPH_CLOSE, _disc(GAP_PX)) > 0
    return [
        (mask, float((sigmas[mask] ** 2).sum()) / 2 / looks)
        for mask in (whole & lasting for whole in _connected(joined))
        if sigmas[mask].max(initial=0.0) > EVIDENT_SIGMAS
    ]


def _disc(width_px: int) -> NDArray[np.uint8]:
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (width_px, width_px))
    return np.asarray(disc, np.uint8)


def _connected(inside: BoolArray) -> list[BoolArray]:
    count, labels = cv2.connectedComponents(inside.astype(np.uint8))
    return [np.asarray(labels == k) for k in range(1, count)]


def _bearing(region: _Region, camera: Camera) -> Bearing:
    rows, columns = np.nonzero(region.mask)
    low = rows >= np.quantile(rows, 1 - BASE_SHARE)
    base: FloatArray = np.array([columns[low].mean(), rows[low].max()])
    sigma_px = np.hypot(columns[low].std(), BASE_SIGMA_PX)
    return Bearing(
        direction_in_cam=camera.rays(base),
        sigma_rad=float(sigma_px / camera.focal_px),
        evidence_nats=region.nats,
        probability=1 - region.false_alarm,
        displacement_px=region.displacement_px,
    )
