"""The column model of a plume, and how well the views speak for a column.

Columns are rows of (N, 8) arrays, so that thousands are scored at once; the world's Z is up.
"""

from typing import NamedTuple, Self

import cv2
import numpy as np

from geometry.arrays import BoolArray, FloatArray, FloatMap
from geometry.grid import lever_gate
from locate.fusion.views import Views

X, Y, Z, SLOPE_X, SLOPE_Y, HEIGHT, RADIUS, OPENING = range(8)
FOOTPRINT_SHARE = 0.85
NEAREST_DEPTH_UNITS = 0.5
EXPLAINED_RADII = 1.5
AGREEING_VIEWS = 3
SHARPNESS, LEAST_LOOKS = 0.75, 1e-6
SAMPLES_AT_ONCE = 100_000


def spine(columns: FloatArray, heights: FloatArray) -> FloatArray:
    """(N, S, 3) points of the axes at (N, S) heights above the columns' lowest points."""
    return np.stack(
        [
            columns[:, X, None] + columns[:, SLOPE_X, None] * heights,
            columns[:, Y, None] + columns[:, SLOPE_Y, None] * heights,
            columns[:, Z, None] + heights,
        ],
        axis=-1,
    )


def axis_direction(column: FloatArray) -> FloatArray:
    """(3,) unit vector along the column's rise."""
    direction = np.array([column[SLOPE_X], column[SLOPE_Y], 1.0])
    return np.asarray(direction / np.linalg.norm(direction))


def slabs(column: FloatArray, heights: FloatArray, thickness: float) -> FloatArray:
    """(S, 8) columns cut from one, each `thickness` high, centred on the (S,) heights.

    Heights below the column's lowest point continue its axis with the radius it has there.
    """
    cut = np.repeat(column[None], len(heights), axis=0)
    low = heights - thickness / 2
    cut[:, [X, Y, Z]] = spine(column[None], low[None])[0]
    cut[:, HEIGHT] = thickness
    cut[:, RADIUS] = column[RADIUS] + column[OPENING] * np.clip(low, 0, None)
    return cut


def score(views: Views, columns: FloatArray, *, along: int = 14, across: int = 5) -> FloatArray:
    """(V, N) evidence of each view for each column, nats; see `sums`."""
    return sums(views, columns, along=along, across=across)[0]


def sums(
    views: Views, columns: FloatArray, *, along: int = 14, across: int = 5
) -> tuple[FloatArray, FloatArray]:
    """What each view says of each column.

    Sums over the column's outline (its side, foreshortened, and its end), gated by what can be seen
    there, counted in independent looks.

    Args:
        views: The evidence.
        columns: (N, 8) columns.
        along: Samples along the axis.
        across: Samples across it.

    Returns:
        (V, N) sum of the llr, nats, and (V, N) number of looks that say anything.
    """
    outlines = _Outlines.of(columns, along)
    across_axis = np.linspace(-1, 1, across, dtype=np.float32)
    nats = np.empty((len(views), len(columns)))
    looks = np.empty_like(nats)
    at_once = max(1, SAMPLES_AT_ONCE // max(1, len(columns) * along * across))
    for start in range(0, len(views), at_once):
        rows = slice(start, start + at_once)
        nats[rows], looks[rows] = _sums_of(views, rows, outlines, across_axis)
    return nats, looks


class _Outlines(NamedTuple):
    """N columns at S heights.

    Attributes:
        points: (N, S, 3) of the axes.
        radii: (N, S) there.
        directions: (N, 3) unit vectors of the axes.
        slab: (N, 1) length of axis that a height stands for.
    """

    points: FloatArray
    radii: FloatArray
    directions: FloatArray
    slab: FloatArray

    @classmethod
    def of(cls, columns: FloatArray, along: int) -> Self:
        heights = columns[:, HEIGHT, None] * (np.arange(along) + 0.5) / along
        axes = np.column_stack([columns[:, [SLOPE_X, SLOPE_Y]], np.ones(len(columns))])
        lengths = np.linalg.norm(axes, axis=1, keepdims=True)
        return cls(
            points=spine(columns, heights),
            radii=columns[:, RADIUS, None] + columns[:, OPENING, None] * heights,
            directions=axes / lengths,
            slab=columns[:, HEIGHT, None] * lengths / along,
        )


def _sums_of(
    views: Views, rows: slice, outlines: _Outlines, across_axis: FloatMap
) -> tuple[FloatArray, FloatArray]:
    """As `sums`, of some views; axes of arrays: view, column, sample along, sample across."""
    points, radii, directions, slab = outlines
    trajectory, focal = views.trajectory, views.trajectory.camera.focal_px
    center_x, center_y = trajectory.camera.matrix[:2, 2]
    nearest = NEAREST_DEPTH_UNITS * views.unit
    seen, background = views.llr[rows], views.inverse_depth[rows]
    count, height, width = seen.shape
    in_cam = points.reshape(-1, 3) @ trajectory.rotations[rows].transpose(0, 2, 1)
    in_cam = (in_cam + trajectory.translations[rows, None]).reshape(count, *points.shape)
    depth = np.maximum(in_cam[..., 2], nearest)
    scale = focal / depth
    half_width_px = FOOTPRINT_SHARE * radii * scale
    x = (in_cam[..., 0] * scale + center_x).astype(np.float32)[..., None]
    x = np.rint(x + half_width_px[..., None].astype(np.float32) * across_axis).astype(np.int32)
    y = np.rint(in_cam[..., 1] * scale + center_y).astype(np.int32)[..., None]
    inside = (x >= 0) & (x < width)
    inside &= (y >= 0) & (y < height) & (in_cam[..., 2] > nearest)[..., None]
    first = np.arange(count, dtype=np.int32)[:, None, None, None] * (height * width)
    flat = np.where(inside, y * width + x, 0) + first
    gate = lever_gate(depth[..., None].astype(np.float32), background.ravel().take(flat)) * inside
    llr = seen.ravel().take(flat)
    rays = points - trajectory.centers_in_world[rows, None, None]
    squared = np.einsum("vnsk,vnsk->vns", rays, rays)
    facing = np.abs(np.einsum("vnsk,nk->vns", rays, directions)) / np.sqrt(squared)
    area = 2 * half_width_px * slab * scale * np.sqrt(np.maximum(1 - facing**2, 0))
    area += np.pi * half_width_px**2 * facing / points.shape[1]
    area /= len(across_axis) * views.correlation_px2
    nats = (np.einsum("vnsa,vnsa->vns", llr, gate) * area).sum(axis=-1)
    looks = (np.einsum("vnsa,vnsa->vns", llr != 0, gate) * area).sum(axis=-1)
    return nats, looks


def agreed(nats: FloatArray) -> FloatArray:
    """(N,) sum of (V, N) evidence in which no view counts for more than the third strongest.

    A column close to one camera fills its frame; without this its clutter alone would carry it.
    """
    rank = min(AGREEING_VIEWS, len(nats))
    limit = np.partition(nats, -rank, axis=0)[-rank]
    return np.asarray(np.minimum(nats, limit).sum(axis=0))


def evidence(views: Views, columns: FloatArray) -> FloatArray:
    """(N,) what all views together say for (N, 8) columns, nats."""
    return agreed(score(views, columns))


def stands_out(views: Views, columns: FloatArray) -> FloatArray:
    """(N,) how clearly (N, 8) columns stand out of what is around them, in no unit of note.

    The sum over views of S / n^0.75, for S nats in n looks. It is largest for a plume's own
    outline: whatever says less than three quarters of the mean inside lessens it, so that a gap
    between plumes, where silence may speak too little against a column over all of them, does.
    """
    nats, looks = sums(views, columns)
    return agreed(np.maximum(nats, 0) / np.maximum(looks, LEAST_LOOKS) ** SHARPNESS)


def covered(views: Views, column: FloatArray) -> BoolArray:
    """(V, H, W) the pixels inside a column's outline that speak for a plume."""
    return np.asarray((views.llr > 0) & (without(views, column, radii=1.0).llr == 0))


def without(views: Views, column: FloatArray, *, radii: float = EXPLAINED_RADII) -> Views:
    """The views with the evidence inside a column's outline, `radii` wide, set to zero.

    What one plume explains must not speak for another.
    """
    wide = column.copy()
    wide[[RADIUS, OPENING]] *= radii
    heights = np.linspace(-0.1, 1.1, 25) * column[HEIGHT]
    points = spine(wide[None], heights[None])[0]
    half_widths = np.maximum(wide[RADIUS] + wide[OPENING] * heights, wide[RADIUS] / 2)
    llr = views.llr.copy()
    for i in range(len(views)):
        in_cam = views.trajectory.world_to_cam(i, points)
        pixels = views.trajectory.camera.project(in_cam)
        ahead = in_cam[:, 2] > 0
        if not ahead.any():
            continue
        half = views.trajectory.camera.focal_px * half_widths[ahead] / in_cam[ahead, 2]
        sideways = np.stack([half, np.zeros_like(half)], axis=1)
        outline = np.concatenate([pixels[ahead] - sideways, (pixels[ahead] + sideways)[::-1]])
        cv2.fillPoly(llr[i], [np.rint(outline).astype(np.int32)], 0.0)
    return views.saying(llr)
