"""Differential optical flow, coarse to fine: Horn-Schunck and Lucas-Kanade."""

from collections.abc import Callable

import cv2
import numpy as np

from detect.warp import blur, gradients, pixel_grid, sample, structure_tensor
from geometry.arrays import FloatMap, GreyImage

COARSEST_SIDE_PX = 48
PRESMOOTHING_PX = 0.7
KEPT_TEXTURE = 0.5

Step = Callable[[FloatMap, FloatMap, FloatMap, FloatMap], FloatMap]


def horn_schunck(
    reference: GreyImage,
    image: GreyImage,
    *,
    smoothness: float = 30.0,
    iterations: int = 60,
    warps: int = 4,
) -> FloatMap:
    """Global flow with a quadratic smoothness term.

    Source: Horn & Schunck, Determining Optical Flow, Artificial Intelligence 1981, eq. 12
    (`smoothness` is their alpha, in grey levels per px), inside a coarse-to-fine warping loop.

    Args:
        reference: (H, W) uint8.
        image: (H, W) uint8.
        smoothness: Weight of smoothness against brightness constancy.
        iterations: Jacobi sweeps per warp.
        warps: Linearisations per pyramid level.

    Returns:
        (H, W, 2) w, px: image(p) = reference(p + w(p)).
    """

    def step(flow: FloatMap, gx: FloatMap, gy: FloatMap, difference: FloatMap) -> FloatMap:
        constant = difference - gx * flow[..., 0] - gy * flow[..., 1]
        scale = 1 / (smoothness**2 + gx * gx + gy * gy)
        u, v = cv2.split(flow)
        for _ in range(iterations):
            mean_u, mean_v = (_neighbour_mean(component) for component in (u, v))
            residual = (gx * mean_u + gy * mean_v + constant) * scale
            u, v = mean_u - gx * residual, mean_v - gy * residual
        return np.asarray(cv2.merge([u, v]))

    return _coarse_to_fine(reference, image, step, warps)


def lucas_kanade(
    reference: GreyImage,
    image: GreyImage,
    *,
    window_px: float = 4.0,
    noise: float = 1.0,
    warps: int = 5,
) -> FloatMap:
    """Dense local flow: least squares in a Gaussian window round every pixel.

    Source: Lucas & Kanade, IJCAI 1981; `noise` (grey levels) damps windows without texture.

    Args:
        reference: (H, W) uint8.
        image: (H, W) uint8.
        window_px: Standard deviation of the window.
        noise: Damping, as the texture that counts as none.
        warps: Linearisations per pyramid level.

    Returns:
        (H, W, 2) w, px: image(p) = reference(p + w(p)).
    """

    def step(flow: FloatMap, gx: FloatMap, gy: FloatMap, difference: FloatMap) -> FloatMap:
        return blur(flow, 1.0) + LeastSquaresWindow(gx, gy, window_px, noise).solve_shift(
            difference
        )

    return _coarse_to_fine(reference, image, step, warps)


class LeastSquaresWindow:
    """Least squares in a Gaussian window round every pixel, for many differences.

    Args:
        gx: (H, W) slope along x, grey levels per px.
        gy: (H, W) along y.
        window_px: Standard deviation of the window.
        noise: Damping, as the texture that counts as none.
    """

    def __init__(self, gx: FloatMap, gy: FloatMap, window_px: float, noise: float) -> None:
        xx, xy, yy = structure_tensor(gx, gy, window_px)
        xx, yy = xx + noise**2, yy + noise**2
        determinant = xx * yy - xy * xy
        self._inverse = (-yy / determinant, xy / determinant, -xx / determinant)
        self._gx, self._gy, self._window_px = gx, gy, window_px

    def solve_shift(self, difference: FloatMap) -> FloatMap:
        """(H, W, 2) the shift s with gx s_x + gy s_y + difference = 0."""
        return np.asarray(cv2.merge(self.shift_planes(difference)))

    def shift_planes(self, difference: FloatMap) -> tuple[FloatMap, FloatMap]:
        """(H, W) s_x and (H, W) s_y of the shift that `solve_shift` returns."""
        tx = blur(self._gx * difference, self._window_px)
        ty = blur(self._gy * difference, self._window_px)
        xx, xy, yy = self._inverse
        along_x, along_y = xx * tx + xy * ty, xy * tx + yy * ty
        return np.asarray(along_x), np.asarray(along_y)


NEIGHBOUR_MEAN = np.array([[1, 2, 1], [2, 0, 2], [1, 2, 1]], dtype=np.float32) / 12


def _neighbour_mean(component: FloatMap) -> FloatMap:
    return np.asarray(cv2.filter2D(component, -1, NEIGHBOUR_MEAN, borderType=cv2.BORDER_REPLICATE))


def _coarse_to_fine(reference: GreyImage, image: GreyImage, step: Step, warps: int) -> FloatMap:
    pairs = _build_pyramid(_presmooth(reference), _presmooth(image))
    flow = np.zeros((*pairs[-1][0].shape, 2), dtype=np.float32)
    for source, target in reversed(pairs):
        height, width = target.shape
        growth = np.array([width / flow.shape[1], height / flow.shape[0]], np.float32)
        flow = np.asarray(cv2.resize(flow, (width, height)) * growth)
        grid = pixel_grid(target.shape)
        for _ in range(warps):
            warped = sample(source, grid + flow)
            gx, gy = gradients((warped + target) / 2)
            flow = step(flow, gx, gy, warped - target)
    return flow


def _build_pyramid(reference: FloatMap, image: FloatMap) -> list[tuple[FloatMap, FloatMap]]:
    """Both images halved while enough of the texture is left.

    Of a lattice that is finer than the pixels of a level only aliasing is left, and its flow leads
    whole periods astray.
    """
    pairs = [(reference, image)]
    least = KEPT_TEXTURE * _mean_gradient(reference)
    while min(pairs[-1][0].shape) > 2 * COARSEST_SIDE_PX:
        coarser = cv2.pyrDown(pairs[-1][0]), cv2.pyrDown(pairs[-1][1])
        if _mean_gradient(coarser[0]) < least:
            break
        pairs.append(coarser)
    return pairs


def _mean_gradient(image: FloatMap) -> float:
    return float(np.sqrt(np.mean(np.square(gradients(image)))))


def _presmooth(image: GreyImage) -> FloatMap:
    return blur(image.astype(np.float32), PRESMOOTHING_PX)
