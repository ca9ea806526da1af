"""Which other frames separate refraction from parallax in this one."""

from collections.abc import Sequence

import cv2
import numpy as np

from detect.detection import Frames
from detect.flow import dis_matcher
from detect.warp import pixel_grid
from geometry.arrays import FloatArray, FloatMap, IntArray
from geometry.epipolar import EpipolarGeometry
from geometry.trajectory import Trajectory

WANTED_PARALLAX = (0.03, 0.045, 0.06, 0.09)
"""Parallax of the neighbours from the nearest to the farthest, in widths of the image; chosen by
hand."""
MOST_PARALLAX = 0.4
"""Parallax from which on a frame is no neighbour, in widths of the image; chosen by hand."""
MIN_OVERLAP = 0.5
"""Share of the image that a neighbour must show."""
SHRINK = 4
"""How many times smaller the images are from which the typical inverse depth is measured."""
ENOUGH_PARALLAX = 0.01
"""Parallax by which it is measured well, in widths of the image; chosen by hand."""
LEAST_SQUARED_LAPLACIAN, FEWEST_TEXTURED = 4, 100
"""Pixels that count there, grey levels squared, and how many are needed; chosen by hand."""


def choose_neighbours(
    trajectory: Trajectory,
    index: int,
    inverse_depth: float,
    count: int,
    b_frames: Sequence[int] | IntArray = (),
) -> list[int]:
    """Frames on both sides of the path whose parallax fits, nearest first.

    Args:
        trajectory: The poses.
        index: Row of the frame in question.
        inverse_depth: What is typical of its scene, 1 / world unit.
        count: How many neighbours; fewer where the path is short.
        b_frames: Rows of frames that are used only where the others are too few.

    Returns:
        Rows of the trajectory, by parallax; half before and half after `index`, more of one side
        where the other has too few.
    """
    parallax = parallax_shares(trajectory, index, inverse_depth)
    rows = np.arange(len(trajectory))
    usable = (parallax > 0) & (parallax < MOST_PARALLAX)
    well_coded = usable & ~np.isin(rows, b_frames)
    usable = well_coded if well_coded.sum() >= count else usable
    before, after = rows[:index][usable[:index]], rows[index + 1 :][usable[index + 1 :]]
    from_before = min(len(before), max(count // 2, count - len(after)))
    chosen = _closest_rows(before, parallax, from_before)
    chosen += _closest_rows(after, parallax, count - from_before)
    return sorted(chosen, key=lambda row: float(parallax[row]))


def _closest_rows(rows: IntArray, parallax: FloatArray, count: int) -> list[int]:
    """The rows nearest to the wanted parallaxes, each once."""
    free = rows.tolist()
    wanted = np.interp(
        np.linspace(0, 1, count), np.linspace(0, 1, len(WANTED_PARALLAX)), WANTED_PARALLAX
    )
    chosen: list[int] = []
    for goal in wanted[: len(free)]:
        best = min(free, key=lambda row: abs(float(np.log(parallax[row] / goal))))
        free.remove(best)
        chosen.append(best)
    return chosen


def parallax_shares(trajectory: Trajectory, index: int, inverse_depth: float) -> FloatArray:
    """(N,) parallax of every frame against `index`, as a share of the image width.

    NaN where less than half of the image is shared.
    """
    camera = trajectory.camera
    size = np.array([camera.width, camera.height])
    pixels = (pixel_grid((6, 8)) + 0.5) * (size / [8, 6]).astype(np.float32)
    pixels = np.broadcast_to(pixels.reshape(1, -1, 2), (len(trajectory), pixels[..., 0].size, 2))
    view = EpipolarGeometry.towards_all(trajectory, index)
    targets = pixels + view.flow(pixels, inverse_depth)
    overlap = ((targets >= 0) & (targets < size)).all(axis=-1).mean(axis=-1)
    shares = np.median(view.parallax_px(pixels, inverse_depth), axis=-1) / camera.width
    return np.where(overlap >= MIN_OVERLAP, shares, np.nan)


def typical_inverse_depth(frames: Frames, trajectory: Trajectory, index: int) -> float:
    """The median inverse depth of a frame, from the flow towards one other frame.

    Steps away from `index` until the flow, its rotation taken out, is large enough to measure.

    Returns:
        1 / world unit; NaN where no frame shows parallax.
    """
    best, best_share = float("nan"), 0.0
    for offset in _growing_offsets(len(frames)):
        for row in (index + offset, index - offset):
            if not 0 <= row < len(frames):
                continue
            inverse_depth, share = _from_pair(frames, trajectory, index, row)
            if inverse_depth > 0 and share > best_share:
                best, best_share = inverse_depth, share
        if best_share > ENOUGH_PARALLAX:
            break
    return best


def _growing_offsets(count: int) -> list[int]:
    return [2**power for power in range(count.bit_length()) if 2**power < count]


def _from_pair(frames: Frames, trajectory: Trajectory, index: int, row: int) -> tuple[float, float]:
    """Median inverse depth by one pair, and its parallax as a share of the image width."""
    image, other = _shrink_image(frames.images[index]), _shrink_image(frames.images[row])
    pixels = pixel_grid(image.shape) * SHRINK + (SHRINK - 1) / 2
    view = EpipolarGeometry.between_frames(trajectory, index, row)
    at_infinity, slope = view.flow_and_slope(pixels, 0.0)
    start = (at_infinity / SHRINK).astype(np.float32)
    flow = dis_matcher(refinements=0).calc(image, other, start) * SHRINK - at_infinity
    steepness = (slope**2).sum(axis=-1)
    inverse_depth = (flow * slope).sum(axis=-1) / np.maximum(steepness, 1e-12)
    textured = cv2.Laplacian(image, cv2.CV_32F) ** 2 > LEAST_SQUARED_LAPLACIAN
    if textured.sum() < FEWEST_TEXTURED or not steepness.any():
        return float("nan"), 0.0
    median = float(np.median(inverse_depth[textured]))
    parallax = view.parallax_px(pixels, max(median, 0.0))
    return median, float(np.median(parallax)) / trajectory.camera.width


def _shrink_image(image: np.ndarray) -> FloatMap:
    return np.asarray(
        cv2.resize(image, None, fx=1 / SHRINK, fy=1 / SHRINK, interpolation=cv2.INTER_AREA)
    )
