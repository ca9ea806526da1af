"""Pixel <-> unit ray. The one place that knows both pixel origins.

The project puts (0, 0) at the centre of the top-left pixel (OpenCV); COLMAP puts that centre at
(0.5, 0.5). Only `to_colmap`, `from_colmap` and the methods that call them see the difference.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import Any, Self

import numpy as np
import pycolmap
from numpy.typing import ArrayLike

from geometry import MOST_PIXELS
from geometry.arrays import FloatArray, FloatMap
from geometry.errors import BadInputError
from geometry.json_values import as_number, as_whole_number
from geometry.lens_keys import refuse_unread_terms

HALF_PIXEL = 0.5
"""Offset from COLMAP's pixel origin, the image corner, to ours, the centre of the first pixel;
px."""

LARGEST_PARAM = 1e7
"""No parameter of a real camera is larger: px, or coefficients of its lens."""


@dataclass(frozen=True, kw_only=True)
class Camera:
    """An intrinsic camera model.

    Attributes:
        model: COLMAP model name, e.g. ``"PINHOLE"`` or ``"SIMPLE_RADIAL"``.
        width: Image width in px, positive.
        height: Image height in px, positive.
        params: Model parameters in COLMAP's order, in px, finite, focal lengths positive; the
            principal point counts from the centre of the top-left pixel.

    Raises:
        BadInputError: One of them is not valid.
    """

    model: str
    width: int
    height: int
    params: tuple[float, ...]

    def __post_init__(self) -> None:
        try:
            model = pycolmap.Camera.create_from_model_name(1, self.model, 1.0, 1, 1)
        except (ValueError, RuntimeError) as error:
            raise BadInputError(f"camera model {self.model!r} is not a COLMAP model") from error
        focal = model.focal_length_idxs()
        if not focal:
            raise BadInputError(f"camera model {self.model} has no focal length; use another model")
        expected = len(model.params)
        if expected != len(self.params):
            raise BadInputError(
                f"camera model {self.model} takes {expected} parameters, got {len(self.params)}"
            )
        if self.width <= 0 or self.height <= 0:
            raise BadInputError(
                f"camera is {self.width}x{self.height} px; width and height must be positive"
            )
        if self.width * self.height > MOST_PIXELS:
            raise BadInputError(
                f"camera is {self.width}x{self.height} px; over {MOST_PIXELS // 10**6} megapixels"
            )
        if not np.isfinite(self.params).all():
            raise BadInputError(f"camera parameters {list(self.params)} must be finite numbers")
        if np.abs(self.params).max() > LARGEST_PARAM:
            raise BadInputError(
                f"a camera parameter of {list(self.params)} is over {LARGEST_PARAM:g}"
            )
        if min(self.params[i] for i in focal) <= 0:
            raise BadInputError(f"camera parameters {list(self.params)} need a focal length > 0 px")

    @classmethod
    def pinhole(cls, width: int, height: int, focal_px: float) -> Self:
        """A square-pixel pinhole camera with its principal point in the image centre."""
        centre = ((width - 1) / 2, (height - 1) / 2)
        return cls(
            model="PINHOLE", width=width, height=height, params=(focal_px, focal_px, *centre)
        )

    @classmethod
    def from_colmap(cls, camera: pycolmap.Camera) -> Self:
        """Reads a COLMAP camera, moving its principal point to the project's pixel origin."""
        params = np.array(camera.params, dtype=float)
        params[list(camera.principal_point_idxs())] -= HALF_PIXEL
        return cls(
            model=camera.model_name,
            width=camera.width,
            height=camera.height,
            params=tuple(float(value) for value in params),
        )

    @classmethod
    def from_dict(cls, block: dict[str, Any]) -> Self:
        """Reads the ``camera`` block of trajectory.json.

        Raises:
            BadInputError: A key is missing or has the wrong type, or one of a lens is beside them.
        """
        try:
            refuse_unread_terms(block, (), f"camera model {block['model']} and its params")
            return cls(
                model=str(block["model"]),
                width=as_whole_number(block["width"], "width"),
                height=as_whole_number(block["height"], "height"),
                params=tuple(as_number(value, "params") for value in block["params"]),
            )
        except (KeyError, TypeError, ValueError, OverflowError) as error:
            raise BadInputError(f"camera block lacks a valid {error}") from error

    def to_dict(self) -> dict[str, Any]:
        """The ``camera`` block of trajectory.json."""
        return {
            "model": self.model,
            "width": self.width,
            "height": self.height,
            "params": list(self.params),
        }

    def to_colmap(self, camera_id: int = 1) -> pycolmap.Camera:
        """The same camera for COLMAP, principal point counted from the image corner."""
        camera = pycolmap.Camera(
            model=self.model, width=self.width, height=self.height, params=list(self.params)
        )
        params = np.array(camera.params, dtype=float)
        params[list(camera.principal_point_idxs())] += HALF_PIXEL
        camera.params = params.tolist()
        camera.camera_id = camera_id
        return camera

    @cached_property
    def _colmap_camera(self) -> pycolmap.Camera:
        return self.to_colmap()

    @property
    def focal_px(self) -> float:
        """Mean focal length in px."""
        return float(self._colmap_camera.mean_focal_length())

    @property
    def is_pinhole(self) -> bool:
        """True where straight lines stay straight."""
        return self.model in ("PINHOLE", "SIMPLE_PINHOLE")

    @property
    def matrix(self) -> FloatArray:
        """The 3x3 calibration matrix of the undistorted camera, project pixel origin."""
        matrix = np.array(self._colmap_camera.calibration_matrix(), dtype=float)
        matrix[:2, 2] -= HALF_PIXEL
        return matrix

    def undistorted(self) -> Self:
        """The pinhole camera of the same size with the same focal lengths and principal point."""
        K = self.matrix
        params = (float(K[0, 0]), float(K[1, 1]), float(K[0, 2]), float(K[1, 2]))
        return type(self)(model="PINHOLE", width=self.width, height=self.height, params=params)

    def scaled(self, factor: float) -> Self:
        """The same camera for images resized by `factor` (both sides rounded to whole px)."""
        camera = self.to_colmap()
        camera.rescale(round(self.width * factor), round(self.height * factor))
        return type(self).from_colmap(camera)

    def rays(self, pixels: ArrayLike) -> FloatArray:
        """Unit viewing rays.

        Args:
            pixels: (..., 2) pixel positions, x right, y down.

        Returns:
            (..., 3) unit vectors in the camera frame (x right, y down, z forward).
        """
        pixels = np.asarray(pixels, dtype=float)
        flat = pixels.reshape(-1, 2) + HALF_PIXEL
        normalised = np.asarray(self._colmap_camera.cam_from_img(flat))
        rays = np.concatenate([normalised, np.ones((len(flat), 1))], axis=1)
        rays /= np.linalg.norm(rays, axis=1, keepdims=True)
        return rays.reshape(*pixels.shape[:-1], 3)

    def project(self, points_in_cam: ArrayLike) -> FloatArray:
        """Pixels of points; NaN for points behind the camera.

        Args:
            points_in_cam: (..., 3) points in the camera frame.

        Returns:
            (..., 2) pixel positions, not clipped to the image.
        """
        points = np.asarray(points_in_cam, dtype=float)
        flat = points.reshape(-1, 3)
        in_front = flat[:, 2] > 1e-9
        safe = np.where(in_front[:, None], flat, [0.0, 0.0, 1.0])
        pixels = np.asarray(self._colmap_camera.img_from_cam(safe)) - HALF_PIXEL
        pixels[~in_front] = np.nan
        return pixels.reshape(*points.shape[:-1], 2)

    def pixel_grid(self) -> FloatMap:
        """(H, W, 2) the position of every pixel."""
        x, y = np.meshgrid(
            np.arange(self.width, dtype=np.float32), np.arange(self.height, dtype=np.float32)
        )
        return np.stack([x, y], axis=-1)

    def undistortion_map(self) -> FloatMap:
        """(H, W, 2) for each pixel of `undistorted()`, where to read this camera's image."""
        rays = self.undistorted().rays(self.pixel_grid())
        return self.project(rays).astype(np.float32)
