"""A camera that stood still: directions to plumes, no positions.

Two measurements give them: evidence in single frames, and displacement that is coherent from one
frame to the next. Each is held against what chance makes of it.
"""

from collections.abc import Sequence
from typing import NamedTuple

import cv2
import numpy as np

from detect.detection import Detection
from detect.haze import Haze
from detect.information import MAP_WIDTH_PX
from detect.response import Response
from geometry.arrays import BoolArray, FloatArray, FloatMap, GreyImage
from geometry.camera import Camera
from locate.fusion.search.null import NULL_DRAWS, SMALLEST_SHIFT, NullLevel
from locate.fusion.still_camera.limit import still_limit_px
from locate.fusion.still_camera.regions import FALSE_ALARM, ImageRegion, connected_parts
from locate.fusion.still_camera.temporal_coherence import find_coherent_regions
from locate.fusion.views import correlation_area
from locate.map.plume import Bearing

EVIDENT_NATS = 0.25
"""Mean evidence of a region's pixels, nats; chosen by hand."""
SMOOTHING_PX = 1.5
"""Standard deviation of the blur of the mean evidence, px of the shrunk maps; chosen by hand."""
BASE_SHARE = 0.1
"""Share of a region's pixels, the lowest, whose middle is its base; chosen by hand."""
EDGE_SIGMA_PX = 2.0
"""How well the edge of a region in single frames is known, px of the shrunk maps; by hand."""
ABOVE_HAZE = 3.0
"""Mean displacement of a plume before haze, in the haze's largest; chosen by hand."""
HAZY = (
    "The air moves all over the image: only what moves the image "
    f"{ABOVE_HAZE:g} times as far is reported."
)
ABOVE_SHAKING = 1.5
"""Mean displacement of a plume in single frames, in the camera's own motion; chosen by hand."""


class StillCameraResult(NamedTuple):
    """What a camera at rest shows.

    Attributes:
        bearings: Strongest first.
        notes: What limits them.
        limit_px: The weakest plume that single frames would show, px; None where they show none, or
            it is not known.
    """

    bearings: tuple[Bearing, ...]
    notes: tuple[str, ...]
    limit_px: float | None


def find_bearings(
    detections: Sequence[Detection],
    camera: Camera,
    *,
    consecutive: Sequence[GreyImage] = (),
    haze: Haze | None = None,
    shaking_px: float = 0.0,
    coarse_coding: bool = False,
    response: Response | None = None,
    seed: int = 0,
) -> StillCameraResult:
    """Regions of evidence that chance does not make.

    Args:
        detections: Of frames by one camera at rest.
        camera: The pinhole that took them.
        consecutive: Frames of it that follow each other closely; too few are not used.
        haze: Of the whole image; then only what moves far more in single frames is a plume.
        shaking_px: Root mean square of the camera's own motion, which was taken out, px of the
            frames. What stands near moves by about as much more, and is no plume.
        coarse_coding: The video has few bits a pixel. Where noise of its codec lasts all over the
            image, single frames look calmer than they are, and no limit can be stated.
        response: Of the detector; None: the hand-made formula.
        seed: Of the random shifts and orders of the nulls.
    """
    small = camera.scaled(min(1.0, MAP_WIDTH_PX / camera.width))
    rng = np.random.default_rng(seed)
    least_px = ABOVE_SHAKING * shaking_px
    if haze is not None:
        least_px = max(ABOVE_HAZE * haze.largest_px, least_px)
        frames = _SingleFrames.of(detections, small, rng)
        strong = [region for region in frames.regions() if region.displacement_px > least_px]
        return StillCameraResult(
            _to_bearings(strong, small),
            (HAZY,) if strong else (),
            frames.limit_px(response, least_px),
        )
    coherent = find_coherent_regions(consecutive, (small.width, small.height), rng)
    known = np.any([coherent.oscillating, *(region.mask for region in coherent.regions)], axis=0)
    frames = _SingleFrames.of(detections, small, rng)
    others = [region for region in frames.regions() if not (region.mask & known).any()]
    moved = [region for region in others if region.displacement_px > least_px]
    notes = coherent.notes
    if len(moved) < len(others):
        notes = (*notes, _shaken_note(shaking_px, len(others) - len(moved)))
    unknown = coarse_coding and coherent.everywhere
    return StillCameraResult(
        _to_bearings([*coherent.regions, *moved], small),
        notes,
        None if unknown else frames.limit_px(response, least_px),
    )


def _shaken_note(shaking_px: float, count: int) -> str:
    places = "one place that moves" if count == 1 else f"{count} places that move"
    return (
        f"The camera shook by {shaking_px:.2g} px rms. That was taken out, but what stands near "
        f"moves more with it: {places} the image less than {ABOVE_SHAKING:g} times as far "
        f"{'is' if count == 1 else 'are'} left out."
    )


class _SingleFrames(NamedTuple):
    """The evidence of single frames on smaller maps (V, H, W), and what chance makes of it."""

    detections: Sequence[Detection]
    llr: FloatMap
    samples: float
    null: NullLevel

    @classmethod
    def of(
        cls, detections: Sequence[Detection], camera: Camera, rng: np.random.Generator
    ) -> "_SingleFrames":
        size = (camera.width, camera.height)
        llr = np.stack([cv2.resize(d.llr, size, interpolation=cv2.INTER_AREA) for d in detections])
        samples = correlation_area(llr)
        draws = [_strongest_by_chance(llr, samples, rng) for _ in range(NULL_DRAWS)]
        return cls(detections, llr, samples, NullLevel.from_draws(draws))

    def regions(self) -> list[ImageRegion]:
        """Regions of positive mean evidence."""
        found = []
        for mask, nats in _evident_regions(self.llr, self.samples):
            if self.null.false_alarm(nats) > FALSE_ALARM:
                continue
            wide = cv2.resize(mask.astype(np.uint8), self.detections[0].llr.shape[::-1]) > 0
            sizes = [np.linalg.norm(d.displacement[wide], axis=-1).mean() for d in self.detections]
            found.append(
                ImageRegion(
                    mask=mask,
                    nats=nats,
                    false_alarm=self.null.false_alarm(nats),
                    displacement_px=float(np.mean(sizes)),
                    edge_sigma_px=EDGE_SIGMA_PX,
                )
            )
        return found

    def limit_px(self, response: Response | None, least_px: float) -> float | None:
        """The weakest plume that would be one of these and moves more than `least_px`."""
        limit_px = still_limit_px(
            self.detections,
            self.llr.shape[:0:-1],
            evident_nats=EVIDENT_NATS,
            least_nats=self.null.threshold(FALSE_ALARM),
            samples=self.samples,
            response=response,
        )
        return None if limit_px is None else max(limit_px, least_px)


def _strongest_by_chance(llr: FloatMap, samples: float, rng: np.random.Generator) -> float:
    width = llr.shape[2]
    shares = rng.uniform(SMALLEST_SHIFT, 1 - SMALLEST_SHIFT, len(llr))
    rolled = [np.roll(m, round(s * width), axis=1) for m, s in zip(llr, shares, strict=True)]
    return max((nats for _, nats in _evident_regions(np.stack(rolled), samples)), default=0.0)


def _evident_regions(llr: FloatMap, samples: float) -> list[tuple[BoolArray, float]]:
    """Connected regions of positive mean evidence: mask and nats of each."""
    mean = cv2.GaussianBlur(llr.mean(axis=0), (0, 0), SMOOTHING_PX)
    total = llr.sum(axis=0)
    return [
        (mask, float(total[mask].sum()) / samples) for mask in connected_parts(mean > EVIDENT_NATS)
    ]


def _to_bearings(regions: Sequence[ImageRegion], camera: Camera) -> tuple[Bearing, ...]:
    """Strongest first."""
    bearings = [_to_bearing(region, camera) for region in regions]
    return tuple(sorted(bearings, key=lambda bearing: -bearing.evidence_nats))


def _to_bearing(region: ImageRegion, camera: Camera) -> Bearing:
    rows, columns = np.nonzero(region.mask)
    low = rows >= np.quantile(rows, 1 - BASE_SHARE)
    base: FloatArray = np.array([columns[low].mean(), rows[low].max()])
    sigma_px = np.hypot(columns[low].std(), region.edge_sigma_px)
    return Bearing(
        direction_in_cam=camera.rays(base),
        sigma_rad=float(sigma_px / camera.focal_px),
        evidence_nats=region.nats,
        probability=1 - region.false_alarm,
        displacement_px=region.displacement_px,
    )
