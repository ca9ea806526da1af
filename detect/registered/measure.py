"""The two stages that turn a frame and its registered neighbours into a displacement."""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from detect.differential import Window
from detect.flow import dis_matcher
from detect.registered.pose_errors import SOME, PoseErrors
from detect.registered.robust import Registered, median, robustly
from detect.registered.separate import TINY, bands, dot, separate, squared
from detect.warp import blur, gradients, sample
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
WHOLE = slice(None)


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


class Registration:
    """One key frame against its neighbours; `measure` runs both stages.

    Args:
        image: (H, W) uint8, the key frame.
        neighbours: The others, by parallax, nearest first.
    """

    def __init__(self, image: GreyImage, neighbours: Sequence[Neighbour]) -> None:
        self._image = image
        self._neighbours = neighbours
        self._y, self._x = (np.arange(n, dtype=np.float32) for n in image.shape)
        self._inverse_depth = np.ones(image.shape, np.float32)
        self._smooth = blur(image.astype(np.float32), PRESMOOTHING_PX)
        self._gradients = gradients(self._smooth)
        self._window = Window(*self._gradients, WINDOW_PX, NOISE)
        self._texture = self._texture_within(WINDOW_PX)

    def measure(self) -> Measurement:
        """Flow, separation, then again on the registered neighbours."""
        flows = self._match()
        poses = PoseErrors(self._inverse_depth)
        pose_errors = self._pose_errors(poses, flows)
        first = self._first_stage(poses, pose_errors, flows)
        return self._second_stage(poses, pose_errors, first)

    def _texture_within(self, sigma_px: float) -> FloatMap:
        gx, gy = self._gradients
        return blur(gx * gx + gy * gy, sigma_px)

    def _predict(self, neighbour: Neighbour, rows: slice = WHOLE) -> tuple[FloatMap, FloatMap]:
        return neighbour.view.over_grid(self._x, self._y[rows], self._inverse_depth[rows])

    def _visible(self, flow: FloatMap, x: FloatMap, y: FloatMap) -> FloatMap:
        """Where pixels of (W,) x and (H,) y that move by (2, H, W) are still in the image."""
        inside = np.ones(flow.shape[1:], np.bool_)
        targets = flow[0] + x, flow[1] + y[:, None]
        for target, side in zip(targets, reversed(self._image.shape), strict=True):
            inside &= target >= BORDER_PX
            inside &= target <= side - 1 - BORDER_PX
        return inside.astype(np.float32)

    def _step_depth(self, step: FloatMap) -> None:
        moved = np.clip(self._inverse_depth + step, 0, NEAREST)
        self._inverse_depth = cv2.medianBlur(moved.astype(np.float32), 5)

    def _match(self) -> list[FloatMap]:
        """Flow towards each neighbour, nearest first; the depth sharpens as they come in."""
        flows: list[FloatMap] = []
        for neighbour in self._neighbours:
            start = cv2.merge(list(self._predict(neighbour)[0]))
            flow = dis_matcher(refinements=0).calc(self._image, neighbour.image, start)
            flows.append(np.ascontiguousarray(np.moveaxis(flow, -1, 0)))
            if len(flows) in (*REFINE_AFTER, len(self._neighbours)):
                self._refine_depth(flows)
        return flows

    def _refine_depth(self, flows: list[FloatMap]) -> None:
        step = np.empty_like(self._inverse_depth)
        for rows in bands(len(step)):
            along, steepness = np.zeros((2, *step[rows].shape), np.float32)
            for flow, neighbour in zip(flows, self._neighbours, strict=False):
                predicted, lever = self._predict(neighbour, rows)
                error = flow[:, rows] - predicted
                weight = self._visible(flow[:, rows], self._x, self._y[rows])
                weight /= 1 + squared(error) / 4
                along += weight * dot(error, lever)
                steepness += weight * squared(lever)
            step[rows] = along / (steepness + TINY)
        self._step_depth(step)

    def _pose_errors(self, poses: PoseErrors, flows: list[FloatMap]) -> list[FloatMap]:
        """What `poses` finds in the flow towards each neighbour."""
        wide = self._texture_within(4.0)[SOME, SOME]
        x, y, textured = self._x[SOME], self._y[SOME], wide / (wide + TEXTURE_HALF)
        found = []
        for flow, neighbour in zip(flows, self._neighbours, strict=True):
            predicted, _ = neighbour.view.over_grid(x, y, self._inverse_depth[SOME, SOME])
            error = np.clip(flow[:, SOME, SOME] - predicted, -4, 4)
            found.append(poses.fit(error, textured * self._visible(predicted, x, y)))
        return found

    def _first_stage(
        self, poses: PoseErrors, pose_errors: list[FloatMap], flows: list[FloatMap]
    ) -> FloatMap:
        """Takes the pose error out of every neighbour, sets the depth; the displacement so far."""
        step, displacement = np.empty_like(self._inverse_depth), np.empty_like(flows[0])
        for rows in bands(len(step)):
            errors, slopes, weights = [], [], []
            for flow, neighbour, found in zip(flows, self._neighbours, pose_errors, strict=True):
                predicted, slope = self._predict(neighbour, rows)
                visible = self._visible(predicted, self._x, self._y[rows])
                error = flow[:, rows] - predicted
                error -= poses.field(found, rows)
                errors.append(error)
                slopes.append(slope)
                weights.append(visible / (1 + 2 * squared(error)))
            answer = separate(errors, slopes, weights)
            step[rows], displacement[:, rows] = answer.inverse_depth_step, answer.displacement
        self._step_depth(np.where(np.abs(step) < 0.3 * self._inverse_depth, step, 0))
        return displacement

    def _second_stage(
        self, poses: PoseErrors, pose_errors: list[FloatMap], first: FloatMap
    ) -> Measurement:
        registered = [
            self._registered(neighbour, poses, pose_error)
            for neighbour, pose_error in zip(self._neighbours, pose_errors, strict=True)
        ]
        misfit, variance, factor, seen, parallax = np.empty((5, *self._image.shape), np.float32)
        displacement = np.empty_like(first)
        for rows in bands(len(misfit)):
            misfit[rows] = median([r.misfit[rows] for r in registered]) + 4
            second = robustly(registered, misfit[rows], rows)
            displacement[:, rows] = second.answer.displacement
            factor[rows] = second.answer.variance_factor
            variance[rows], seen[rows] = second.variance, second.seen
            parallax[rows] = np.sqrt(np.max([squared(r.slope[:, rows]) for r in registered], 0))
        step = np.abs(self._inverse_depth - blur(self._inverse_depth, 5.0)) * parallax
        return Measurement(
            displacement=_limited(self._without_drift(displacement, seen)),
            first_displacement=_limited(first),
            misfit=misfit,
            scatter_px=np.sqrt(variance / 2),
            variance_factor=factor,
            visible=seen,
            texture=self._texture,
            relative_inverse_depth=self._inverse_depth,
            depth_edge_px=cv2.dilate(step, np.ones((5, 5), np.uint8)),
        )

    def _registered(
        self, neighbour: Neighbour, poses: PoseErrors, pose_error: FloatMap
    ) -> Registered:
        shape = self._image.shape
        visible, slope = np.empty(shape, np.float32), np.empty((2, *shape), np.float32)
        positions = np.empty((*shape, 2), np.float32)
        for rows in bands(len(visible)):
            flow, slope[:, rows] = self._predict(neighbour, rows)
            flow += poses.field(pose_error, rows)
            visible[rows] = self._visible(flow, self._x, self._y[rows])
            flow[0] += self._x
            flow[1] += self._y[rows, None]
            positions[rows] = cv2.merge(list(flow))
        image = sample(neighbour.image, positions)
        shift = self._window.shift_planes(blur(image, PRESMOOTHING_PX) - self._smooth)
        return Registered(
            shift=np.clip(shift, -MAX_RESIDUAL_PX, MAX_RESIDUAL_PX),
            slope=slope,
            visible=visible,
            misfit=blur((image - self._image) ** 2, WINDOW_PX),
        )

    def _without_drift(self, displacement: FloatMap, seen: FloatMap) -> FloatMap:
        """Takes out what looks like an error of the key frame's own pose."""
        texture = self._texture[SOME, SOME]
        textured = texture / (texture + TEXTURE_HALF) * (seen[SOME, SOME] > 1)
        w = np.clip(displacement, -MAX_RESIDUAL_PX, MAX_RESIDUAL_PX)
        poses = PoseErrors(self._inverse_depth)
        drift = poses.fit(w[:, SOME, SOME], textured)
        for rows in bands(len(seen)):
            w[:, rows] -= poses.field(drift, rows)
        return w


def _limited(planes: FloatMap) -> FloatMap:
    """(H, W, 2) of (2, H, W)."""
    clipped = np.clip(planes, -MAX_RESIDUAL_PX, MAX_RESIDUAL_PX)
    return np.ascontiguousarray(np.moveaxis(clipped, 0, -1))
