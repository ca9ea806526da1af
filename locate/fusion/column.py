"""The column model of a plume, and how well the views speak for a column.

Columns are rows of (N, 8) arrays, so that thousands are scored at once; the world's Z is up.
"""

from dataclasses import replace

import cv2
import numpy as np

from geometry.arrays import FloatArray
from geometry.grid import lever_gate
from locate.fusion.views import Views

X, Y, Z, SLOPE_X, SLOPE_Y, HEIGHT, RADIUS, OPENING = range(8)
FOOTPRINT_SHARE = 0.85
NEAREST_DEPTH_UNITS = 0.5
EXPLAINED_RADII = 1.5
AGREEING_VIEWS = 3


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
    """(V, N) evidence of each view for each column, nats.

    The sum of the llr over the column's outline (its side, foreshortened, and its end), gated by
    what can be seen there, counted in independent looks.

    Args:
        views: The evidence.
        columns: (N, 8) columns.
        along: Samples along the axis.
        across: Samples across it.
    """
    camera = views.trajectory.camera
    focal = camera.focal_px
    nearest = NEAREST_DEPTH_UNITS * views.unit
    height, width = views.llr.shape[1:]
    centers = views.trajectory.centers_in_world
    heights = columns[:, HEIGHT, None] * (np.arange(along) + 0.5) / along
    points = spine(columns, heights)
    radii = columns[:, RADIUS, None] + columns[:, OPENING, None] * heights
    offsets = np.linspace(-FOOTPRINT_SHARE, FOOTPRINT_SHARE, across)
    axes = np.column_stack([columns[:, [SLOPE_X, SLOPE_Y]], np.ones(len(columns))])
    lengths = np.linalg.norm(axes, axis=1, keepdims=True)
    nats = np.empty((len(views), len(columns)))
    for i in range(len(views)):
        in_cam = views.trajectory.world_to_cam(i, points)
        depth = np.maximum(in_cam[..., 2], nearest)
        pixels = in_cam[..., :2] / depth[..., None] * focal + camera.matrix[:2, 2]
        radii_px = focal * radii / depth
        x = np.rint(pixels[..., 0, None] + radii_px[..., None] * offsets).astype(np.int64)
        y = np.rint(pixels[..., 1]).astype(np.int64)[..., None]
        inside = (x >= 0) & (x < width) & (y >= 0) & (y < height)
        inside &= (in_cam[..., 2] > nearest)[..., None]
        flat = np.where(inside, y * width + x, 0)
        background = views.inverse_depth[i].ravel()[flat]
        gate = lever_gate(depth[..., None].astype(np.float32), background) * inside
        rays = points - centers[i]
        facing = np.einsum("nsk,nk->ns", rays, axes / lengths) / np.linalg.norm(rays, axis=-1)
        slab_px = focal * columns[:, HEIGHT, None] * lengths / along / depth
        half_width_px = FOOTPRINT_SHARE * radii_px
        area = 2 * half_width_px * slab_px * np.sqrt(np.maximum(1 - facing**2, 0))
        area += np.pi * half_width_px**2 * np.abs(facing) / along
        per_height = (views.llr[i].ravel()[flat] * gate).mean(axis=-1)
        nats[i] = (per_height * area).sum(axis=-1)
    return nats / views.correlation_px2


def agreed(nats: FloatArray) -> FloatArray:
    """(N,) sum of (V, N) evidence in which no view counts for more than the third strongest.

    A column close to one camera fills its frame; without this its clutter alone would carry it.
    """
    rank = min(AGREEING_VIEWS, len(nats))
    limit = np.partition(nats, -rank, axis=0)[-rank]
    return np.asarray(np.minimum(nats, limit).sum(axis=0))


def without(views: Views, column: FloatArray) -> Views:
    """The views with the evidence inside a column's outline, somewhat widened, set to zero.

    What one plume explains must not speak for another.
    """
    wide = column.copy()
    wide[[RADIUS, OPENING]] *= EXPLAINED_RADII
    heights = np.linspace(-0.1, 1.1, 25) * column[HEIGHT]
    points = spine(wide[None], heights[None])[0]
    radii = np.maximum(wide[RADIUS] + wide[OPENING] * heights, wide[RADIUS] / 2)
    llr = views.llr.copy()
    for i in range(len(views)):
        in_cam = views.trajectory.world_to_cam(i, points)
        pixels = views.trajectory.camera.project(in_cam)
        ahead = in_cam[:, 2] > 0
        if not ahead.any():
            continue
        half = views.trajectory.camera.focal_px * radii[ahead] / in_cam[ahead, 2]
        sideways = np.stack([half, np.zeros_like(half)], axis=1)
        outline = np.concatenate([pixels[ahead] - sideways, (pixels[ahead] + sideways)[::-1]])
        cv2.fillPoly(llr[i], [np.rint(outline).astype(np.int32)], 0.0)
    return replace(views, llr=llr)
