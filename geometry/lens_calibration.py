"""The lens of a camera from pictures of a flat board, by OpenCV.

Of several models the simplest is taken that explains boards which it was not fitted to.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import cv2
import numpy as np

from geometry.angle_of_view import refuse_wide_lens
from geometry.arrays import FloatArray
from geometry.camera import Camera
from geometry.errors import BadInputError

LensName = Literal["pinhole", "radial", "fisheye"]
LENSES: tuple[LensName, ...] = ("pinhole", "radial", "fisheye")
"""From the simplest: no distortion, k1 and k2, and four terms of an equidistant fisheye."""
FEWEST_VIEWS = 8
"""Pictures of the board that are needed; half of them decide which model is taken."""
AS_GOOD = 1.1
"""Error on other boards, over the least, up to which the simplest model is taken; by hand."""
LEAST_COVER = 0.5
"""Share of the width and of the height that the corners of all pictures must span."""
MOST_RMS_PX = 1.5
"""Error of a fit from which the board is bent, blurred or not the stated one; by hand."""
_ZERO = cv2.CALIB_ZERO_TANGENT_DIST | cv2.CALIB_FIX_K3
_FLAGS = {"pinhole": _ZERO | cv2.CALIB_FIX_K1 | cv2.CALIB_FIX_K2, "radial": _ZERO}


@dataclass(frozen=True, kw_only=True)
class BoardView:
    """The corners of the board in one picture.

    Attributes:
        name: Of the picture.
        on_board: (N, 2) places on the board, in any unit.
        in_image: (N, 2) px.
    """

    name: str
    on_board: FloatArray
    in_image: FloatArray


@dataclass(frozen=True, kw_only=True)
class LensCalibration:
    """A camera, and how well it explains the boards.

    Attributes:
        camera: Its model is PINHOLE, OPENCV or OPENCV_FISHEYE.
        lens: Name of the model.
        rms_px: Root mean square distance of the corners from where the camera puts them.
        others_px: The same of boards that a fit to the other half had not seen.
        residuals_px: For each view (N, 2), seen minus put.
    """

    camera: Camera
    lens: LensName
    rms_px: float
    others_px: float
    residuals_px: tuple[FloatArray, ...]


def calibrate_lens(
    views: Sequence[BoardView], size: tuple[int, int], lens: LensName | None = None
) -> LensCalibration:
    """Fits a camera to pictures of a board.

    Args:
        views: Of the board, from different sides and in all parts of the image.
        size: Width and height of the pictures, px.
        lens: The model; None takes the simplest that explains the boards.

    Raises:
        BadInputError: Too few pictures or too small a part of the image, a fit that is off, or a
            lens that sees too much.
    """
    if len(views) < FEWEST_VIEWS:
        raise BadInputError(
            f"the board is seen in {len(views)} pictures that differ, {FEWEST_VIEWS} are needed; "
            "film it from more sides, and check --board"
        )
    corners = np.concatenate([view.in_image for view in views])
    cover = np.ptp(corners, axis=0) / size
    if (cover < LEAST_COVER).any():
        raise BadInputError(
            f"the board covers {cover[0]:.0%} of the width and {cover[1]:.0%} of the height in all "
            f"({LEAST_COVER:.0%} are needed); film it in every part of the image"
        )
    fitted = {name: _others_px(views, size, name) for name in (LENSES if lens is None else [lens])}
    best = min(fitted.values())
    if not np.isfinite(best):
        raise BadInputError("no camera explains the boards; check --board, film more slowly")
    chosen = next(name for name, error_px in fitted.items() if error_px <= AS_GOOD * best)
    camera = _fit(views, size, chosen)
    residuals = tuple(_residuals(view, camera) for view in views)
    rms_px = _rms(np.concatenate(residuals))
    if rms_px > MOST_RMS_PX:
        raise BadInputError(
            f"the corners are {rms_px:.1f} px off (at most {MOST_RMS_PX:g}): a board that is bent, "
            "pictures that are blurred, another --board, or another --lens"
        )
    refuse_wide_lens(camera)
    return LensCalibration(
        camera=camera,
        lens=chosen,
        rms_px=rms_px,
        others_px=fitted[chosen],
        residuals_px=residuals,
    )


def _fit(views: Sequence[BoardView], size: tuple[int, int], lens: LensName) -> Camera:
    """The camera of these views.

    Raises:
        BadInputError: OpenCV finds none.
    """
    flat = [np.pad(view.on_board, ((0, 0), (0, 1))).astype(np.float32) for view in views]
    seen = [view.in_image.astype(np.float32) for view in views]
    width, height = size
    try:
        if lens == "fisheye":
            _, matrix, terms, _, _ = cv2.fisheye.calibrate(
                [points[None] for points in flat],
                [points[None] for points in seen],
                size,
                np.eye(3),
                np.zeros(4),
                flags=cv2.CALIB_RECOMPUTE_EXTRINSIC | cv2.CALIB_FIX_SKEW,
            )
            distortion = np.ravel(terms)[:4].tolist()
        else:
            _, matrix, terms, _, _ = cv2.calibrateCamera(
                flat, seen, size, np.eye(3), np.zeros(5), flags=_FLAGS[lens]
            )
            distortion = [] if lens == "pinhole" else np.ravel(terms)[:4].tolist()
    except cv2.error as error:
        raise BadInputError(f"OpenCV finds no {lens} camera") from error
    model = {"pinhole": "PINHOLE", "radial": "OPENCV", "fisheye": "OPENCV_FISHEYE"}[lens]
    params = (matrix[0, 0], matrix[1, 1], matrix[0, 2], matrix[1, 2], *distortion)
    return Camera(model=model, width=width, height=height, params=tuple(map(float, params)))


def _others_px(views: Sequence[BoardView], size: tuple[int, int], lens: LensName) -> float:
    """Error on each half of the views by a fit to the other; infinite where there is none."""
    errors = []
    for half in (0, 1):
        try:
            camera = _fit(views[half::2], size, lens)
            errors += [_residuals(view, camera) for view in views[1 - half :: 2]]
        except BadInputError:
            return np.inf
    return _rms(np.concatenate(errors))


def _residuals(view: BoardView, camera: Camera) -> FloatArray:
    """(N, 2) seen minus put, the board where it fits best; inf where it fits nowhere.

    Raises:
        BadInputError: The camera sees some of the corners nowhere.
    """
    rays = camera.rays(view.in_image)
    if not (np.isfinite(rays).all() and (rays[:, 2] > 0).all()):
        raise BadInputError("corners behind the camera")
    flat = np.pad(view.on_board, ((0, 0), (0, 1)))
    on_plane = np.ascontiguousarray(rays[:, :2] / rays[:, 2:])
    found, turn, shift = cv2.solvePnP(flat, on_plane, np.eye(3), None)
    if not found:
        raise BadInputError("the board fits nowhere")
    in_cam = flat @ cv2.Rodrigues(turn)[0].T + shift.ravel()
    return np.asarray(view.in_image - camera.project(in_cam))


def _rms(residuals: FloatArray) -> float:
    return float(np.sqrt((residuals**2).sum(axis=1).mean()))
