"""Reading images between pixels, and the gradients that go with it."""

import cv2
import numpy as np

from geometry.arrays import FloatMap

HALF_WAY = np.array([3, -25, 150, 150, -25, 3], dtype=np.float32) / 256


def pixel_grid(shape: tuple[int, ...]) -> FloatMap:
    """(H, W, 2) the position (x, y) of every pixel."""
    y, x = np.mgrid[: shape[0], : shape[1]].astype(np.float32)
    return np.stack([x, y], axis=-1)


def doubled(image: np.ndarray) -> FloatMap:
    """The image at twice its size, its own pixels untouched: pixel p lies at 2 p.

    Between them is a symmetric six-tap filter, so nothing moves.
    """
    height, width = image.shape
    image = image.astype(np.float32)
    between = cv2.filter2D(image, -1, HALF_WAY[None], anchor=(2, 0))
    double = np.empty((height, 2, 2 * width), np.float32)
    cv2.merge([image, between], dst=double[:, 0].reshape(height, width, 2))
    cv2.filter2D(double[:, 0], -1, HALF_WAY[:, None], dst=double[:, 1], anchor=(0, 2))
    return double.reshape(2 * height, 2 * width)


def sample(image: np.ndarray, positions: FloatMap) -> FloatMap:
    """The image at (H, W, 2) positions in px; beyond its edge, the edge.

    Read linearly from the doubled image. OpenCV 5's cubic `remap` and `resize` move a small shift
    1.2 to 1.4 times too far and its Lanczos rounds to 1/32 px; this is within 0.005 px.
    """
    values = cv2.remap(
        doubled(image),
        (2 * positions).astype(np.float32, copy=False),
        None,
        cv2.INTER_LINEAR,
        borderMode=cv2.BORDER_REPLICATE,
    )
    return np.asarray(values)


def blur(image: FloatMap, sigma_px: float) -> FloatMap:
    """Gaussian blur."""
    return np.asarray(cv2.GaussianBlur(image, (0, 0), sigma_px), dtype=np.float32)


def gradients(image: np.ndarray) -> tuple[FloatMap, FloatMap]:
    """The slopes along x and y, grey levels per px (Scharr)."""
    along_x = cv2.Scharr(image, cv2.CV_32F, 1, 0, scale=1 / 32)
    along_y = cv2.Scharr(image, cv2.CV_32F, 0, 1, scale=1 / 32)
    return np.asarray(along_x), np.asarray(along_y)


def structure_tensor(
    along_x: FloatMap, along_y: FloatMap, sigma_px: float
) -> tuple[FloatMap, FloatMap, FloatMap]:
    """The windowed means of gx gx, gx gy and gy gy."""
    return (
        blur(along_x * along_x, sigma_px),
        blur(along_x * along_y, sigma_px),
        blur(along_y * along_y, sigma_px),
    )
