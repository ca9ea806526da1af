"""The evidence of all views, brought to one modest size, with the scale of the scene."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Self

import cv2
import numpy as np

from detect.detection import Detection
from detect.information import MAP_WIDTH_PX, DisplacementInformation
from geometry.arrays import BoolArray, FloatArray, FloatMap
from geometry.grid import VoxelBox
from geometry.trajectory import Trajectory

VOXELS_ALONG_LONGEST_EDGE = 96
"""Of the evidence grid; chosen by hand."""
RANGE_TO_UNIT = 0.1
"""The unit of fusion, in median ranges to the background; defines it."""
FARTHEST_RANGES = 10
"""Background farther than so many median ranges is left out of the volume; chosen by hand."""
OUTLIERS_PERCENT = 2
"""Percentile of the background that bounds the volume on either side; chosen by hand."""
TURBULENCE_PX = 0.1
"""Standard deviation of the displacement by turbulence, px of the original frames; by hand."""
BACKGROUND_STEP_PX = 8
"""One background point per so many px along each side; chosen by hand."""
CLIPPED_PERCENTILE = 95
"""Of each map, above which evidence may be a plume's and not noise; chosen by hand."""
CORRELATION_REACH_PX = 12
"""Farthest shift whose autocorrelation counts, px of the maps; chosen by hand."""
FEWEST_PAIRS = 0.001
"""Of the most pairs of pixels at one shift: of fewer their mean says nothing."""
FREE_OF_EVIDENCE = {"unit", "bending_px", "lowest_background"}
"""What is worked out once for all views that differ in their evidence alone."""


@dataclass(frozen=True, kw_only=True)
class Views:
    """V views of evidence.

    The last of them may hold information of the displacement alone: they have no evidence
    of pixels (llr 0, sigma inf).

    Attributes:
        trajectory: V poses; the camera is a pinhole of the maps' size.
        llr: (V, H, W) evidence, nats per pixel.
        inverse_depth: (V, H, W) of the background, 1 / world unit; NaN where unknown.
        displacement: (V, H, W, 2) px of the original frames, x right, y down.
        sigma_px: (V, H, W) standard deviation of either component, same px; inf where nothing was
            measured.
        correlation_px2: Area over which the evidence of plume-free pixels is correlated, px of
            these maps squared; so many pixels count as one independent sample.
        information: V normal equations of the displacement, as large as the maps; empty where
            the detector does not measure them.
        displacement_only: How many of the views, the last ones, hold information alone.
        foreseen: (V, H, W) evidence that a plume would bring, in its mean; None where that is not
            known: then all pixels with evidence count alike.
    """

    trajectory: Trajectory
    llr: FloatMap
    inverse_depth: FloatMap
    displacement: FloatMap
    sigma_px: FloatMap
    correlation_px2: float
    information: tuple[DisplacementInformation, ...] = ()
    displacement_only: int = 0
    foreseen: FloatMap | None = None

    @classmethod
    def from_detections(
        cls,
        detections: Sequence[Detection],
        trajectory: Trajectory,
        displacements: Sequence[Detection] = (),
    ) -> Self:
        """Shrinks the maps by area averaging to at most `MAP_WIDTH_PX` wide.

        Args:
            detections: Those without inverse depth hold no evidence in 3D.
            trajectory: The V poses of these and of the next; the camera is the pinhole of the
                full-size frames.
            displacements: Detections with information alone.
        """
        factor = min(1.0, MAP_WIDTH_PX / trajectory.camera.width)
        camera = trajectory.camera.scaled(factor)

        def shrink_map(image: FloatMap) -> FloatMap:
            size = (camera.width, camera.height)
            return np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA), np.float32)

        evident = len(detections)
        detections = [*detections, *displacements]
        llr = np.stack([shrink_map(d.llr) for d in detections])
        unknown = np.full(detections[0].llr.shape, np.nan, np.float32)
        depth = [unknown if d.inverse_depth is None else d.inverse_depth for d in detections]
        return cls(
            trajectory=replace(trajectory, camera=camera),
            llr=llr,
            inverse_depth=np.stack(
                [_shrink_nearest(d, camera.width, camera.height) for d in depth]
            ),
            displacement=np.stack([shrink_map(d.displacement) for d in detections]),
            sigma_px=np.stack(
                [_shrink_nearest(d.sigma_px, camera.width, camera.height) for d in detections]
            ),
            correlation_px2=correlation_area(llr[:evident]),
            information=_sum_information(detections, camera.width, camera.height),
            displacement_only=len(displacements),
        )

    def __len__(self) -> int:
        return len(self.trajectory)

    @property
    def by_pixels(self) -> Self:
        """The views that have evidence of pixels."""
        return self._pixel_views if self.displacement_only else self

    @cached_property
    def _pixel_views(self) -> Self:
        count = len(self) - self.displacement_only
        return replace(
            self,
            trajectory=self.trajectory.take(range(count)),
            llr=self.llr[:count],
            inverse_depth=self.inverse_depth[:count],
            displacement=self.displacement[:count],
            sigma_px=self.sigma_px[:count],
            information=self.information[:count],
            displacement_only=0,
        )

    def rolled_sideways(self, shifts_px: Sequence[int]) -> Self:
        """Every view's maps turned sideways by its own shift, the poses left where they are.

        What the views agreed on is gone, what each of them holds alone is kept.
        """

        def roll_maps(maps: FloatMap) -> FloatMap:
            return np.stack([np.roll(m, s, axis=1) for m, s in zip(maps, shifts_px, strict=True)])

        rolled = replace(self, llr=roll_maps(self.llr), inverse_depth=roll_maps(self.inverse_depth))
        vars(rolled)["unit"] = self.unit
        return rolled

    def with_evidence(
        self,
        llr: FloatMap,
        information: tuple[DisplacementInformation, ...] | None = None,
        correlation_px2: float | None = None,
        foreseen: FloatMap | None = None,
    ) -> Self:
        """The same views with other evidence, (V, H, W), and perhaps other information.

        What does not depend on them is kept; `correlation_px2` too, where it is not given.
        """
        other = replace(
            self,
            llr=llr,
            information=self.information if information is None else information,
            correlation_px2=correlation_px2 or self.correlation_px2,
            foreseen=foreseen,
        )
        kept = vars(self).keys() & FREE_OF_EVIDENCE
        vars(other).update({name: vars(self)[name] for name in kept})
        return other

    @cached_property
    def unit(self) -> float:
        """A tenth of the median range to the background, world units: the unit of fusion.

        Views with information alone do not count, so that they do not change it.
        """
        measured = self.inverse_depth[: len(self) - self.displacement_only]
        finite = measured[measured > 0]
        return float(RANGE_TO_UNIT / np.median(finite)) if finite.size else np.nan

    @cached_property
    def bending_px(self) -> FloatMap:
        """(V, H, W) length of the displacement, less what its noise adds, px."""
        length = np.linalg.norm(self.displacement, axis=-1)
        return np.asarray(np.sqrt(length**2 - np.minimum(self.sigma_px, length) ** 2))

    @cached_property
    def measured_mask(self) -> FloatMap:
        """(V, H, W) 1 where there is a displacement and evidence for or against it, else 0."""
        return np.asarray((self.llr != 0) & np.isfinite(self.sigma_px), dtype=np.float32)

    @cached_property
    def displacement_precision(self) -> FloatMap:
        """(V, H, W) of a component of the displacement against turbulence and noise, 1 / px^2.

        0 where there is no evidence.
        """
        variance = self.sigma_px**2 + np.float32(TURBULENCE_PX**2)
        return np.asarray(self.measured_mask / variance)

    @cached_property
    def lowest_background(self) -> float:
        """World Z of the lowest background, outliers apart."""
        return float(np.percentile(self.background_in_world()[:, 2], OUTLIERS_PERCENT))

    def background_in_world(self, step: int = BACKGROUND_STEP_PX) -> FloatArray:
        """(N, 3) points on the background, one per `step` px along each side."""
        pixels = self.trajectory.camera.pixel_grid()[::step, ::step].reshape(-1, 2)
        homogeneous = np.column_stack([pixels, np.ones(len(pixels))])
        rays = homogeneous @ np.linalg.inv(self.trajectory.camera.matrix).T
        farthest = FARTHEST_RANGES * self.unit / RANGE_TO_UNIT
        points = []
        for i in range(len(self)):
            inverse_depth = self.inverse_depth[i, ::step, ::step].reshape(-1)
            known = inverse_depth > 1 / farthest
            in_cam = rays[known] / inverse_depth[known, None]
            moved = in_cam - self.trajectory.translations[i]
            points.append(moved @ self.trajectory.rotations[i])
        return np.concatenate(points)

    def volume(self) -> VoxelBox:
        """The box that holds the cameras and nearly all of the background."""
        points = self.background_in_world()
        centers = self.trajectory.centers_in_world
        low = np.percentile(points, OUTLIERS_PERCENT, axis=0)
        high = np.percentile(points, 100 - OUTLIERS_PERCENT, axis=0)
        low = np.minimum(low, centers.min(axis=0))
        high = np.maximum(high, centers.max(axis=0))
        return VoxelBox.from_corners(low, high, longest=VOXELS_ALONG_LONGEST_EDGE)


def _sum_information(
    detections: Sequence[Detection], width: int, height: int
) -> tuple[DisplacementInformation, ...]:
    """The information of every view; nothing where no view has any, zeros where one has none."""
    found = [detection.information for detection in detections]
    if not any(found):
        return ()
    nothing = DisplacementInformation(
        vector=np.zeros((height, width, 2), np.float32),
        matrix=np.zeros((height, width, 3), np.float32),
    )
    return tuple(
        nothing if information is None else information.summed_to(width, height)
        for information in found
    )


def _shrink_nearest(image: FloatMap, width: int, height: int) -> FloatMap:
    resized = cv2.resize(image, (width, height), interpolation=cv2.INTER_NEAREST_EXACT)
    return np.asarray(resized, np.float32)


def correlation_area(llr: FloatMap) -> float:
    """Area over which (V, H, W) maps are correlated: the integral of their autocorrelation, px^2.

    The few strongest values (a plume, if there is one) are clipped, so that they do not pass for
    noise.
    """
    clipped = _clip_strongest(llr)
    centred = clipped - clipped.mean(axis=(1, 2), keepdims=True)
    variance = float((centred**2).mean())
    if variance == 0:
        return 1.0
    correlation = _near_products(centred) / (variance * llr.shape[1] * llr.shape[2])
    return float(max(1.0, np.maximum(correlation, 0).sum()))


def correlation_area_of(llr: FloatMap, counted: BoolArray) -> float:
    """As `correlation_area`, of the pixels that count, (V, H, W), alone.

    Each product is a mean over the pairs of pixels that both count.
    """
    clipped = np.where(counted, _clip_strongest(llr), 0.0)
    pixels = np.maximum(counted.sum(axis=(1, 2), keepdims=True), 1)
    mean = clipped.sum(axis=(1, 2), keepdims=True) / pixels
    centred = np.where(counted, clipped - mean, 0.0)
    variance = float((centred**2).sum() / max(int(counted.sum()), 1))
    if variance == 0:
        return 1.0
    pairs = _near_products(counted.astype(np.float32))
    few = FEWEST_PAIRS * float(pairs.max())
    correlation = _near_products(centred) / (variance * np.maximum(pairs, few))
    return float(max(1.0, np.maximum(correlation, 0).sum()))


def _clip_strongest(llr: FloatMap) -> FloatMap:
    highest = np.percentile(llr, CLIPPED_PERCENTILE, axis=(1, 2), keepdims=True)
    return np.asarray(np.minimum(llr, highest))


def _near_products(maps: FloatArray | FloatMap) -> FloatArray:
    """Products of (V, H, W) maps with themselves, shifted by up to `CORRELATION_REACH_PX`.

    Summed over the pixels, the mean of the maps.
    """
    shape = [2 * n for n in maps.shape[1:]]
    power = (np.abs(np.fft.rfft2(maps, shape)) ** 2).mean(axis=0)
    products = np.fft.irfft2(power, shape)
    reach = min(CORRELATION_REACH_PX, *maps.shape[1:])
    near = np.concatenate([products[:reach], products[-reach + 1 :]])
    return np.concatenate([near[:, :reach], near[:, -reach + 1 :]], axis=1)
