"""The two stages that turn a frame and its registered neighbours into a displacement."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from detect.differential import LeastSquaresWindow
from detect.flow import dis_matcher
from detect.information import DisplacementInformation
from detect.registered.full_size import FullSizeFrames, visible_mask
from detect.registered.information import RegisteredFrames, displacement_information
from detect.registered.pose_errors import SOME, PoseErrors
from detect.registered.robust_separation import RegisteredNeighbours, median_map, separate_robust
from detect.registered.separation import (
    TINY,
    dot_product,
    row_bands,
    separate_parallax,
    squared_length,
)
from detect.warp import blur, gradients, sample
from geometry.arrays import FloatMap, GreyImage
from geometry.epipolar import EpipolarGeometry

PRESMOOTHING_PX = 0.7
"""Standard deviation of the blur before gradients are taken, px; chosen by hand."""
WINDOW_PX = 2.0
"""Standard deviation of the window in which displacement is measured, px; chosen by hand."""
NOISE = 1.4
"""Damping of `LeastSquaresWindow`, grey levels per px; chosen by hand."""
MAX_RESIDUAL_PX = 3.0
"""Larger displacements are cut to it; chosen by hand."""
POSE_WINDOW_PX = 4.0
"""Standard deviation of the window of the texture by which pixels count for a pose, px."""
TEXTURE_HALF = 4.0
"""Texture with which a pixel counts half there, (grey levels per px) squared."""
KNOWN_TEXTURE = 1.0
"""Texture from which on the inverse depth is known, (grey levels per px) squared."""
NEAREST = 20.0
"""Largest inverse depth, in units of the scene's typical one."""
REFINE_AFTER = (2, 4)
"""Numbers of neighbours after which the depth is refined, before all of them."""
MOST_DEPTH_STEP = 0.3
"""Share of an inverse depth by which the first stage may change it; larger changes are errors."""
LEAST_MISFIT = 4.0
"""Added to the usual misfit: what noise leaves, grey levels squared."""


@dataclass(frozen=True, kw_only=True)
class Neighbour:
    """Another frame, and how pixels of the key frame move into it by relative inverse depth."""

    image: GreyImage
    view: EpipolarGeometry


@dataclass(frozen=True, kw_only=True)
class Measurement:
    """What the neighbours measure in one frame, (H, W) each.

    Attributes:
        displacement: (H, W, 2) w, px.
        first_displacement: (H, W, 2) w as optical flow alone gives it, smoother, px.
        misfit: Usual squared difference from the registered neighbours, grey levels squared.
        scatter_px: Standard deviation of the neighbours' residuals, one component.
        variance_factor: Variance of w for residuals of unit variance.
        visible: In how many neighbours a pixel is seen, with weights from 0 to 1.
        one_sidedness: How many times as uncertain w is as if all neighbours saw a pixel alike.
        texture: Mean squared gradient round a pixel, (grey levels per px) squared.
        relative_inverse_depth: In units of the scene's typical one, cleaned by a median filter.
        depth_edge_px: By how much parallax varies between a pixel and its surroundings.
        information: Normal equations of w of all pixels; None of a measurement from a file.
    """

    displacement: FloatMap
    first_displacement: FloatMap
    misfit: FloatMap
    scatter_px: FloatMap
    variance_factor: FloatMap
    visible: FloatMap
    one_sidedness: FloatMap
    texture: FloatMap
    relative_inverse_depth: FloatMap
    depth_edge_px: FloatMap
    information: DisplacementInformation | None = None

    def inverse_depth(self, unit: float) -> FloatMap:
        """(H, W) of the background, 1 / world unit; NaN where there is too little texture.

        Args:
            unit: Of the relative inverse depth, 1 / world unit.
        """
        known = self.texture > KNOWN_TEXTURE
        depth = np.where(known, self.relative_inverse_depth, np.nan) * unit
        return depth.astype(np.float32)


class Registration:
    """One key frame against its neighbours; `measure` runs both stages.

    Args:
        image: (H, W) uint8, the key frame.
        neighbours: The others, by parallax, nearest first.
        full_size: Reads the key frame and the neighbours at full size, (H', W') grey levels each,
            for the information of all pixels; None: that is taken from the images above.
    """

    def __init__(
        self,
        image: GreyImage,
        neighbours: Sequence[Neighbour],
        full_size: Callable[[], Sequence[FloatMap]] | None = None,
    ) -> None:
        self._image = image
        self._neighbours = neighbours
        self._full_size = full_size
        self._y, self._x = (np.arange(n, dtype=np.float32) for n in image.shape)
        self._inverse_depth = np.ones(image.shape, np.float32)
        self._grey = image.astype(np.float32)
        self._smooth = blur(self._grey, PRESMOOTHING_PX)
        self._gradients = gradients(self._smooth)
        self._window = LeastSquaresWindow(*self._gradients, WINDOW_PX, NOISE)
        self._texture = self._texture_within(WINDOW_PX)

    def measure(self) -> Measurement:
        """Flow, separation, then again on the registered neighbours."""
        flows = self._match_neighbours()
        poses = PoseErrors(self._inverse_depth)
        pose_errors = self._pose_errors(poses, flows)
        first = self._first_stage(poses, pose_errors, flows)
        return self._second_stage(self._register_neighbours(poses, pose_errors), first)

    def _texture_within(self, sigma_px: float) -> FloatMap:
        gx, gy = self._gradients
        return blur(gx * gx + gy * gy, sigma_px)

    def _predict_flow(self, rows: slice, count: int | None = None) -> tuple[FloatMap, FloatMap]:
        """(N, 2, h, W) flow towards the first neighbours, or all; (N, 2, h, W) its slope."""
        views = [neighbour.view for neighbour in self._neighbours[:count]]
        inverse_depth = self._inverse_depth[rows]
        flow, slope = np.empty((2, len(views), 2, *inverse_depth.shape), np.float32)
        for k, view in enumerate(views):
            view.over_grid(self._x, self._y[rows], inverse_depth, (flow[k], slope[k]))
        return flow, slope

    def _visible_mask(self, flow: FloatMap, rows: slice) -> FloatMap:
        """(..., h, W) where the pixels of some rows are still in the image when they have moved."""
        return visible_mask(flow, self._x, self._y[rows], self._image.shape)

    def _step_depth(self, step: FloatMap) -> None:
        moved = np.clip(self._inverse_depth + step, 0, NEAREST)
        self._inverse_depth = cv2.medianBlur(moved.astype(np.float32), 5)

    def _match_neighbours(self) -> FloatMap:
        """(N, 2, H, W) flow towards each neighbour; the depth sharpens as they come in."""
        flows = np.empty((len(self._neighbours), 2, *self._image.shape), np.float32)
        for k, neighbour in enumerate(self._neighbours):
            predicted, _ = neighbour.view.over_grid(self._x, self._y, self._inverse_depth)
            start = cv2.merge(list(predicted))
            flow = dis_matcher(refinements=0).calc(self._image, neighbour.image, start)
            flows[k] = np.moveaxis(flow, -1, 0)
            if k + 1 in (*REFINE_AFTER, len(flows)):
                self._refine_depth(flows[: k + 1])
        return flows

    def _refine_depth(self, flows: FloatMap) -> None:
        step = np.empty_like(self._inverse_depth)
        for rows in row_bands(len(step)):
            flow = flows[:, :, rows]
            predicted, lever = self._predict_flow(rows, len(flows))
            error = flow - predicted
            weights = self._visible_mask(flow, rows) / (1 + squared_length(error) / 4)
            along = np.einsum("nij,nij->ij", weights, dot_product(error, lever))
            steepness = np.einsum("nij,nij->ij", weights, squared_length(lever))
            step[rows] = along / (steepness + TINY)
        self._step_depth(step)

    def _pose_errors(self, poses: PoseErrors, flows: FloatMap) -> FloatMap:
        """(N, 2, 9) what `poses` finds in the flow towards each neighbour."""
        wide = self._texture_within(POSE_WINDOW_PX)[SOME, SOME]
        x, y, textured = self._x[SOME], self._y[SOME], wide / (wide + TEXTURE_HALF)
        found = []
        for flow, neighbour in zip(flows, self._neighbours, strict=True):
            predicted, _ = neighbour.view.over_grid(x, y, self._inverse_depth[SOME, SOME])
            error = np.clip(flow[:, SOME, SOME] - predicted, -4, 4)
            visible = visible_mask(predicted, x, y, self._image.shape)
            found.append(poses.fit(error, textured * visible))
        return np.asarray(found)

    def _first_stage(self, poses: PoseErrors, pose_errors: FloatMap, flows: FloatMap) -> FloatMap:
        """Takes the pose error out of every neighbour, sets the depth; the displacement so far."""
        step = np.empty_like(self._inverse_depth)
        displacement = np.empty(flows.shape[1:], np.float32)
        for rows in row_bands(len(step)):
            predicted, slopes = self._predict_flow(rows)
            visible = self._visible_mask(predicted, rows)
            errors = flows[:, :, rows] - predicted
            errors -= poses.error_fields(pose_errors, rows)
            answer = separate_parallax(errors, slopes, visible / (1 + 2 * squared_length(errors)))
            step[rows], displacement[:, rows] = answer.inverse_depth_step, answer.displacement
        self._step_depth(np.where(np.abs(step) < MOST_DEPTH_STEP * self._inverse_depth, step, 0))
        return displacement

    def _register_neighbours(
        self, poses: PoseErrors, pose_errors: FloatMap
    ) -> RegisteredNeighbours:
        count, shape = len(self._neighbours), self._image.shape
        flows, shifts, slopes = np.empty((3, count, 2, *shape), np.float32)
        visible, misfits, images = np.empty((3, count, *shape), np.float32)
        for rows in row_bands(len(self._y)):
            flow, slopes[:, :, rows] = self._predict_flow(rows)
            flow += poses.error_fields(pose_errors, rows)
            flows[:, :, rows] = flow
            visible[:, rows] = self._visible_mask(flow, rows)
            np.add(flow[:, 0], self._x, out=shifts[:, 0, rows])
            np.add(flow[:, 1], self._y[rows, None], out=shifts[:, 1, rows])
        for k, neighbour in enumerate(self._neighbours):
            images[k] = sample(neighbour.image, cv2.merge(list(shifts[k])))
            shift = self._window.shift_planes(blur(images[k], PRESMOOTHING_PX) - self._smooth)
            np.clip(shift, -MAX_RESIDUAL_PX, MAX_RESIDUAL_PX, out=shifts[k])
            misfits[k] = blur((images[k] - self._grey) ** 2, WINDOW_PX)
        return RegisteredNeighbours(
            images=images,
            flows=flows,
            shifts=shifts,
            slopes=slopes,
            visible=visible,
            misfits=misfits,
        )

    def _second_stage(self, registered: RegisteredNeighbours, first: FloatMap) -> Measurement:
        shape = (6, *self._image.shape)
        misfit, variance, factor, seen, one_sided, parallax = np.empty(shape, np.float32)
        displacement = np.empty_like(first)
        for rows in row_bands(len(misfit)):
            misfit[rows] = median_map(registered.misfits[:, rows]) + LEAST_MISFIT
            second = separate_robust(registered, misfit[rows], rows)
            displacement[:, rows] = second.answer.displacement
            factor[rows] = second.answer.variance_factor
            variance[rows], seen[rows] = second.variance, second.seen
            one_sided[rows] = second.one_sidedness
            parallax[rows] = np.sqrt(squared_length(registered.slopes[:, :, rows]).max(axis=0))
        step = np.abs(self._inverse_depth - blur(self._inverse_depth, 5.0)) * parallax
        depth_edge_px = cv2.dilate(step, np.ones((5, 5), np.uint8))
        return Measurement(
            displacement=_clip_planes(self._without_drift(displacement, seen)),
            first_displacement=_clip_planes(first),
            misfit=misfit,
            scatter_px=np.sqrt(variance / 2),
            variance_factor=factor,
            visible=seen,
            one_sidedness=one_sided,
            texture=self._texture,
            relative_inverse_depth=self._inverse_depth,
            depth_edge_px=depth_edge_px,
            information=self._information(registered, depth_edge_px),
        )

    def _information(
        self, registered: RegisteredNeighbours, depth_edge_px: FloatMap
    ) -> DisplacementInformation:
        if self._full_size is not None:
            return FullSizeFrames(
                images=self._full_size(),
                flows=registered.flows,
                slopes=registered.slopes,
                depth_edge_px=depth_edge_px,
            ).measure()
        return displacement_information(
            RegisteredFrames(
                key=self._grey,
                neighbours=registered.images,
                slopes=registered.slopes,
                visible=registered.visible,
                depth_edge_px=depth_edge_px,
            )
        )

    def _without_drift(self, displacement: FloatMap, seen: FloatMap) -> FloatMap:
        """Takes out what looks like an error of the key frame's own pose."""
        texture = self._texture[SOME, SOME]
        textured = texture / (texture + TEXTURE_HALF) * (seen[SOME, SOME] > 1)
        w = np.clip(displacement, -MAX_RESIDUAL_PX, MAX_RESIDUAL_PX)
        poses = PoseErrors(self._inverse_depth)
        drift = poses.fit(w[:, SOME, SOME], textured)
        for rows in row_bands(len(seen)):
            w[:, rows] -= poses.error_fields(drift, rows)
        return w


def _clip_planes(planes: FloatMap) -> FloatMap:
    """(H, W, 2) of (2, H, W)."""
    clipped = np.clip(planes, -MAX_RESIDUAL_PX, MAX_RESIDUAL_PX)
    return np.ascontiguousarray(np.moveaxis(clipped, 0, -1))
