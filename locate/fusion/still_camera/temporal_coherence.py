"""Regions before a camera at rest whose displacement is coherent from one frame to the next.

They show fluctuations far below the noise of a single frame. What oscillates, as branches and
flags do, is left out.
"""

from collections.abc import Sequence
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from detect.fluctuation import Fluctuation
from geometry.arrays import BoolArray, FloatMap, GreyImage
from locate.fusion.search.null import NullLevel
from locate.fusion.still_camera.regions import FALSE_ALARM, ImageRegion, connected_parts
from locate.fusion.views import correlation_area

COHERENT_SIGMAS, EVIDENT_SIGMAS = 2.0, 3.5
"""Above chance, of every pixel of a region and of its strongest one; chosen by hand."""
GAP_PX, BLURRED_PX = 15, 17
"""Regions less than `GAP_PX` apart are one; `BLURRED_PX` is the width that pooling smears a region
over; px of the shrunk maps, chosen by hand."""
FEWEST_FRAMES, LEAST_NATS = 24, 20.0
"""Frames that are needed, and evidence that a region needs whatever chance makes; by hand."""
ONLY_STRONG = "only what single frames show is reported; weaker plumes are missed."
TOO_SLOW = (
    f"Fewer than {FEWEST_FRAMES} frames are known to follow each other within a tenth of a second "
    f"(photos have no times; of a video half of --max-frames follow each other): {ONLY_STRONG}"
)
EVERYWHERE = (
    "Something lasts from frame to frame all over the image (noise of compressed video, a shaking "
    f"camera, or much that moves): {ONLY_STRONG}"
)


class CoherentRegions(NamedTuple):
    """What is coherent in time.

    Attributes:
        regions: Those that may be air.
        oscillating: (H, W) where something oscillates.
        notes: What limits this.
        everywhere: Something lasts all over the image, and hides what is coherent.
    """

    regions: list[ImageRegion]
    oscillating: BoolArray
    notes: tuple[str, ...]
    everywhere: bool = False


def find_coherent_regions(
    images: Sequence[GreyImage], size: tuple[int, int], rng: np.random.Generator
) -> CoherentRegions:
    """Finds what moves coherently in frames by a camera at rest that follow each other closely.

    Args:
        images: The frames; too few yield nothing.
        size: Width and height of the maps to make of them, px.
        rng: Of the random orders that show what chance makes.
    """
    still = np.zeros(size[::-1], dtype=bool)
    if len(images) < FEWEST_FRAMES:
        return CoherentRegions([], still, (TOO_SLOW,))
    small = [cv2.resize(image, size, interpolation=cv2.INTER_AREA) for image in images]
    measured = Fluctuation.measure(small, rng)
    if measured.is_everywhere:
        return CoherentRegions([], still, (EVERYWHERE,), everywhere=True)
    samples = correlation_area(measured.shuffled_sigmas)
    null = NullLevel.from_draws(
        [_strongest_region(sigmas, samples) for sigmas in measured.shuffled_sigmas]
    )
    level = max(LEAST_NATS, null.threshold(FALSE_ALARM))
    scale, unblurred = images[0].shape[1] / size[0], _unblurred_pixels(measured.sigmas)
    regions, oscillating = [], []
    for mask, nats in _evident_regions(measured.sigmas, samples):
        if nats < level:
            continue
        if measured.oscillates(mask):
            oscillating.append(mask)
            continue
        inside = mask & unblurred
        regions.append(
            ImageRegion(
                mask=inside,
                nats=nats,
                false_alarm=null.false_alarm(nats),
                displacement_px=scale * float(np.sqrt(measured.covariance_px2[inside].mean())),
                edge_sigma_px=BLURRED_PX / 2,
            )
        )
    notes = (_oscillation_note(len(oscillating)),) if oscillating else ()
    return CoherentRegions(regions, np.any([still, *oscillating], axis=0), notes)


def _oscillation_note(count: int) -> str:
    places = "One place moves" if count == 1 else f"{count} places move"
    return (
        f"{places} to and fro as branches and flags do, and no plume is reported there. "
        "(A flame that puffs regularly does too.)"
    )


def _strongest_region(sigmas: FloatMap, samples: float) -> float:
    return max((nats for _, nats in _evident_regions(sigmas, samples)), default=0.0)


def _evident_regions(sigmas: FloatMap, samples: float) -> list[tuple[BoolArray, float]]:
    """Regions above zero, somewhere clearly: mask and nats of each.

    What is less than `GAP_PX` apart is one: a plume shows only before a textured background.
    """
    coherent = sigmas > COHERENT_SIGMAS
    joined = cv2.morphologyEx(coherent.astype(np.uint8), cv2.MORPH_CLOSE, _disc_kernel(GAP_PX)) > 0
    return [
        (mask, float((sigmas[mask] ** 2).sum()) / 2 / samples)
        for mask in (whole & coherent for whole in connected_parts(joined))
        if sigmas[mask].max(initial=0.0) > EVIDENT_SIGMAS
    ]


def _unblurred_pixels(sigmas: FloatMap) -> BoolArray:
    """(H, W) where pooled sigmas are above half of those around: what was pooled ends there."""
    return np.asarray(sigmas > cv2.dilate(sigmas, _disc_kernel(BLURRED_PX)) / 2)


def _disc_kernel(width_px: int) -> NDArray[np.uint8]:
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (width_px, width_px))
    return np.asarray(disc, np.uint8)
