"""The two stages that turn a frame and its registered neighbours into a displacement."""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from detect.differential import Window
from detect.flow import dis_matcher
from detect.registered.separate import (
    TINY,
    Separation,
    as_complex,
    bands,
    dot,
    pose_like_field,
    separate,
    squared,
)
from detect.warp import blur, gradients, pixel_grid, sample
from geometry.arrays import FloatMap, GreyImage
from geometry.epipolar import Epipolar

BORDER_PX = 2
PRESMOOTHING_PX = 0.7
WINDOW_PX = 2.0
NOISE = 1.4
MAX_RESIDUAL_PX = 3.0
TEXTURE_HALF = 4.0
NEAREST = 20.0
REFINE_AFTER = (2, 4)


@dataclass(frozen=True, kw_only=True)
class Neighbour:
    """Another frame, and how pixels of the key frame move into it by relative inverse depth."""

    image: GreyImage
    view: Epipolar


@dataclass(frozen=True, kw_only=True)
class Measurement:
    """What the neighbours say of one frame, (H, W) each.

    Attributes:
        displacement: (H, W, 2) w, px.
        first_displacement: (H, W, 2) w as optical flow alone gives it, smoother, px.
        misfit: Usual squared difference from the registered neighbours, grey levels squared.
        scatter_px: Standard deviation of the neighbours' residuals, one component.
        variance_factor: Variance of w for residuals of unit variance.
        visible: In how many neighbours a pixel is seen, with weights from 0 to 1.
        texture: Mean squared gradient round a pixel, (grey levels per px) squared.
        relative_inverse_depth: In units of the scene's typical one, cleaned by a median filter.
        depth_edge_px: By how much parallax varies between a pixel and its surroundings.
    """

    displacement: FloatMap
    first_displacement: FloatMap
    misfit: FloatMap
    scatter_px: FloatMap
    variance_factor: FloatMap
    visible: FloatMap
    texture: FloatMap
    relative_inverse_depth: FloatMap
    depth_edge_px: FloatMap


@dataclass(frozen=True, kw_only=True)
class _Robust:
    """The answer without outliers, its residual variance, and the weight that was left."""

    answer: Separation
    variance: FloatMap
    seen: FloatMap


class Registration:
    """One key frame against its neighbours; `measure` runs both stages.

    Args:
        image: (H, W) uint8, the key frame.
        neighbours: The others, by parallax, nearest first.
    """

    def __init__(self, image: GreyImage, neighbours: Sequence[Neighbour]) -> None:
        self._image = image
        self._neighbours = neighbours
        self._pixels = pixel_grid(image.shape)
        self._inverse_depth = np.ones(image.shape, np.float32)
        self._smooth = blur(image.astype(np.float32), PRESMOOTHING_PX)
        self._gradients = gradients(self._smooth)
        self._window = Window(*self._gradients, WINDOW_PX, NOISE)
        self._texture = self._texture_within(WINDOW_PX)

    def measure(self) -> Measurement:
        """Flow, separation, then again on the registered neighbours."""
        flows = self._match()
        pose_errors, first = self._first_stage(flows)
        return self._second_stage(pose_errors, first)

    def _texture_within(self, sigma_px: float) -> FloatMap:
        gx, gy = self._gradients
        return blur(gx * gx + gy * gy, sigma_px)

    def _predict(self, neighbour: Neighbour) -> tuple[FloatMap, FloatMap]:
        return neighbour.view.over_rows(self._inverse_depth)

    def _pose_like(self, field: FloatMap, weights: FloatMap) -> FloatMap:
        return pose_like_field(field, self._inverse_depth, weights)

    def _visible(self, flow: FloatMap) -> FloatMap:
        height, width = self._image.shape
        most = (width - 1 - BORDER_PX, height - 1 - BORDER_PX)
        inside = cv2.inRange(self._pixels + flow, (BORDER_PX, BORDER_PX), most)
        return np.asarray(inside > 0, dtype=np.float32)

    def _step_depth(self, step: FloatMap) -> None:
        moved = np.clip(self._inverse_depth + step, 0, NEAREST)
        self._inverse_depth = cv2.medianBlur(moved.astype(np.float32), 5)

    def _match(self) -> list[FloatMap]:
        """Flow towards each neighbour, nearest first; the depth sharpens as they come in."""
        flows: list[FloatMap] = []
        for neighbour in self._neighbours:
            start, _ = self._predict(neighbour)
            flows.append(dis_matcher(refinements=0).calc(self._image, neighbour.image, start))
            if len(flows) in (*REFINE_AFTER, len(self._neighbours)):
                self._refine_depth(flows)
        return flows

    def _refine_depth(self, flows: list[FloatMap]) -> None:
        visible = [self._visible(flow) for flow in flows]
        step = np.empty_like(self._inverse_depth)
        for rows in bands(len(step)):
            along, steepness = np.zeros((2, *step[rows].shape), np.float32)
            for flow, seen, neighbour in zip(flows, visible, self._neighbours, strict=False):
                predicted, slope = neighbour.view.over_rows(self._inverse_depth[rows], rows.start)
                error, lever = as_complex(flow[rows] - predicted), as_complex(slope)
                weight = seen[rows] / (1 + squared(error) / 4)
                along += weight * dot(error, lever)
                steepness += weight * squared(lever)
            step[rows] = along / (steepness + TINY)
        self._step_depth(step)

    def _first_stage(self, flows: list[FloatMap]) -> tuple[list[FloatMap], FloatMap]:
        """Takes the pose error out of every neighbour and sets the depth.

        Returns:
            Those errors, and the displacement so far.
        """
        wide = self._texture_within(4.0)
        textured = wide / (wide + TEXTURE_HALF)
        errors, slopes, weights, pose_errors = [], [], [], []
        for flow, neighbour in zip(flows, self._neighbours, strict=True):
            predicted, slope = self._predict(neighbour)
            error, visible = flow - predicted, self._visible(predicted)
            pose_errors.append(self._pose_like(np.clip(error, -4, 4), textured * visible))
            errors.append(error - pose_errors[-1])
            slopes.append(slope)
            weights.append(visible / (1 + 2 * squared(as_complex(errors[-1]))))
        first = separate(np.array(errors), np.array(slopes), np.array(weights))
        step, limit = first.inverse_depth_step, 0.3 * self._inverse_depth
        self._step_depth(np.where(np.abs(step) < limit, step, 0))
        return pose_errors, first.displacement

    def _second_stage(self, pose_errors: list[FloatMap], first: FloatMap) -> Measurement:
        shifts, slopes, visible, misfits = [], [], [], []
        for neighbour, pose_error in zip(self._neighbours, pose_errors, strict=True):
            predicted, slope = self._predict(neighbour)
            flow = predicted + pose_error
            registered = sample(neighbour.image, self._pixels + flow)
            shifts.append(self._shift(registered))
            misfits.append(blur((registered - self._image) ** 2, WINDOW_PX))
            visible.append(self._visible(flow))
            slopes.append(slope)
        usual_misfit = np.median(misfits, axis=0) + 4
        weights = np.array(visible) / (1 + (np.array(misfits) / usual_misfit) ** 2)
        second = self._robustly(np.array(shifts), np.array(slopes), weights.astype(np.float32))
        return self._measured(second, np.array(slopes), first, usual_misfit)

    def _shift(self, registered: FloatMap) -> FloatMap:
        """How far the registered neighbour still is from the key frame, px."""
        difference = blur(registered, PRESMOOTHING_PX) - self._smooth
        return np.clip(self._window.shift(difference), -MAX_RESIDUAL_PX, MAX_RESIDUAL_PX)

    def _robustly(self, shifts: FloatMap, slopes: FloatMap, weights: FloatMap) -> _Robust:
        for _ in range(2):
            answer = separate(shifts, slopes, weights)
            squares = answer.squared_residuals(shifts, slopes)
            variance = (weights * squares).sum(axis=0) / (weights.sum(axis=0) + TINY)
            used = weights
            weights = weights / (1 + squares / (4 * variance + 1e-4))
        return _Robust(answer=answer, variance=variance, seen=used.sum(axis=0))

    def _measured(
        self, second: _Robust, slopes: FloatMap, first: FloatMap, misfit: FloatMap
    ) -> Measurement:
        parallax = np.abs(as_complex(slopes)).max(axis=0)
        step = np.abs(self._inverse_depth - blur(self._inverse_depth, 5.0)) * parallax
        textured = self._texture / (self._texture + TEXTURE_HALF)
        w = np.clip(second.answer.displacement, -MAX_RESIDUAL_PX, MAX_RESIDUAL_PX)
        drift = self._pose_like(w, textured * (second.seen > 1))
        return Measurement(
            displacement=np.clip(w - drift, -MAX_RESIDUAL_PX, MAX_RESIDUAL_PX),
            first_displacement=np.clip(first, -MAX_RESIDUAL_PX, MAX_RESIDUAL_PX),
            misfit=misfit,
            scatter_px=np.sqrt(second.variance / 2),
            variance_factor=second.answer.variance_factor,
            visible=second.seen,
            texture=self._texture,
            relative_inverse_depth=self._inverse_depth,
            depth_edge_px=cv2.dilate(step, np.ones((5, 5), np.uint8)),
        )
