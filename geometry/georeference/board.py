"""Scale from a printed board of ArUco or AprilTag markers of known size, seen in the frames."""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from scipy.optimize import least_squares

from geometry.arrays import FloatArray, GreyImage
from geometry.covariance import split_information, standard_deviations
from geometry.errors import BadInputError
from geometry.georeference.constraints import ScaleConstraint, apply_tangent
from geometry.georeference.lengths import nearest_point
from geometry.similarity import Similarity, align_points
from geometry.trajectory import Trajectory

MIN_VIEWS = 2
"""Fewest frames that a corner or a board must be found in to be triangulated."""
MIN_CORNERS = 4
"""Fewest corners of a board in a frame: those of one marker."""
ROBUST_PX = 1.0
"""Reprojection error, px, beyond which the soft L1 loss grows linearly; chosen."""

MAX_BOARD_PX = 4.0
"""Median reprojection error, px, beyond which the corners are not those of one board; chosen."""


@dataclass(frozen=True, kw_only=True)
class BoardSighting:
    """Corners of a board in one frame.

    Attributes:
        row: Of the frame in the trajectory.
        corners_on_board_m: (K, 3), z = 0.
        pixels: (K, 2), project pixel origin.
    """

    row: int
    corners_on_board_m: FloatArray
    pixels: FloatArray


def marker_board(
    dictionary: str, *, columns: int = 1, rows: int = 1, size_m: float, gap_m: float = 0.0
) -> Any:
    """A grid of markers, or a single one, as ``cv2.aruco`` has it.

    Args:
        dictionary: Name in OpenCV without its prefix, ``"4X4_50"``, ``"APRILTAG_36h11"``, ...
        columns: Markers side by side; ids count along the rows.
        rows: Markers above each other.
        size_m: Side of the black square.
        gap_m: Between neighbours.

    Raises:
        BadInputError: No such dictionary, or a size that is not positive.
    """
    known = getattr(cv2.aruco, f"DICT_{dictionary}", None)
    if known is None:
        raise BadInputError(f"board: no marker dictionary {dictionary!r}; try 4X4_50")
    if not (size_m > 0 and gap_m >= 0 and columns > 0 and rows > 0):
        raise BadInputError("board: its size must be positive")
    markers = cv2.aruco.getPredefinedDictionary(known)
    if columns * rows > len(markers.bytesList):
        raise BadInputError(f"board: {dictionary} has {len(markers.bytesList)} markers, no more")
    return cv2.aruco.GridBoard((columns, rows), size_m, gap_m or size_m, markers)


def find_board(images: Iterable[GreyImage], board: Any) -> list[BoardSighting]:
    """Looks for the board in every frame; frames without it are left out.

    Args:
        images: The frames of a trajectory, in its order.
        board: From `marker_board`, or any other board of ``cv2.aruco``.
    """
    parameters = cv2.aruco.DetectorParameters()
    parameters.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_SUBPIX
    detector = cv2.aruco.ArucoDetector(board.getDictionary(), parameters)
    sightings = []
    for row, image in enumerate(images):
        corners, ids, _ = detector.detectMarkers(image)
        if ids is None:
            continue
        on_board, pixels = board.matchImagePoints(corners, ids)
        if on_board is not None and len(on_board) >= MIN_CORNERS:
            sightings.append(
                BoardSighting(
                    row=row,
                    corners_on_board_m=np.reshape(on_board, (-1, 3)).astype(float),
                    pixels=np.reshape(pixels, (-1, 2)).astype(float),
                )
            )
    return sightings


def scale_from_board(
    trajectory: Trajectory,
    sightings: list[BoardSighting],
    *,
    size_sigma: float = 0.002,
    name: str = "marker board",
) -> ScaleConstraint:
    """Fits the board with free size to all its sightings at once; its size is the scale.

    The covariance treats all corners of a frame as one observation (a cluster sandwich), because
    an error of the frame's pose moves them together.

    Args:
        trajectory: The cameras.
        sightings: From `find_board`.
        size_sigma: Relative error of the printed size.
        name: Of the source.

    Raises:
        BadInputError: Seen from fewer than two places, or the sightings do not fit together.
    """
    if len(sightings) < MIN_VIEWS:
        raise BadInputError(
            f"{name}: found in {len(sightings)} frames, at least {MIN_VIEWS} are needed; "
            "film it larger, flat and in focus"
        )
    start = _from_triangulation(trajectory, sightings, name)

    def residuals(step: FloatArray) -> FloatArray:
        return np.concatenate(
            [r.ravel() for r in _reprojection_errors(trajectory, sightings, start, step)]
        )

    found = least_squares(residuals, np.zeros(7), x_scale="jac", loss="soft_l1", f_scale=ROBUST_PX)
    off_px = float(np.median(np.linalg.norm(np.reshape(found.fun, (-1, 2)), axis=1)))
    if off_px > MAX_BOARD_PX:
        raise BadInputError(
            f"{name}: its corners are {off_px:.1f} px (median) from where one board would be; it "
            "must lie still, and its columns, rows, size and gap must be those of the print"
        )
    try:
        covariance = _cluster_covariance(np.asarray(found.jac), found.fun, sightings)
    except np.linalg.LinAlgError as error:
        raise BadInputError(f"{name}: seen from one place only; move the camera") from error
    scene_from_board = apply_tangent(start, found.x)
    return ScaleConstraint(
        name=name,
        metres_per_unit=1 / scene_from_board.scale,
        sigma_log=float(np.hypot(standard_deviations(covariance)[6], size_sigma)),
    )


def _reprojection_errors(
    trajectory: Trajectory, sightings: list[BoardSighting], start: Similarity, step: FloatArray
) -> list[FloatArray]:
    scene_from_board = apply_tangent(start, step)
    projected = (
        trajectory.project(s.row, scene_from_board(s.corners_on_board_m)) for s in sightings
    )
    # A corner behind a camera projects nowhere: a large error sends the fit back.
    return [
        np.nan_to_num(pixels - s.pixels, nan=1e3)
        for s, pixels in zip(sightings, projected, strict=True)
    ]


def _cluster_covariance(
    jacobian: FloatArray, residuals: FloatArray, sightings: list[BoardSighting]
) -> FloatArray:
    ends = np.cumsum([s.pixels.size for s in sightings])[:-1]
    slopes = np.array(
        [j.T @ r for j, r in zip(np.split(jacobian, ends), np.split(residuals, ends), strict=True)]
    )
    n = len(sightings)
    inverse, unknown = split_information(jacobian.T @ jacobian)
    if unknown.size:
        raise np.linalg.LinAlgError("the sightings leave the board's place free")
    few = n / (n - 1) * residuals.size / max(residuals.size - 7, 1)
    return np.asarray(few * inverse @ (slopes.T @ slopes) @ inverse)


def _from_triangulation(
    trajectory: Trajectory, sightings: list[BoardSighting], name: str
) -> Similarity:
    """``scene_from_board`` from the corners triangulated one by one."""
    rays: dict[tuple[float, ...], list[tuple[FloatArray, FloatArray]]] = {}
    centers = trajectory.centers_in_world
    for s in sightings:
        directions = trajectory.camera.rays(s.pixels) @ trajectory.rotations[s.row]
        for corner, direction in zip(s.corners_on_board_m, directions, strict=True):
            rays.setdefault(tuple(corner), []).append((centers[s.row], direction))
    seen = {corner: np.array(found) for corner, found in rays.items() if len(found) >= MIN_VIEWS}
    if len(seen) < MIN_CORNERS:
        raise BadInputError(f"{name}: no {MIN_CORNERS} corners are seen in two frames")
    try:
        points = np.array([nearest_point(found[:, 0], found[:, 1]) for found in seen.values()])
    except np.linalg.LinAlgError as error:
        raise BadInputError(f"{name}: seen from one place only; move the camera") from error
    return align_points(np.array(list(seen)), points)
