"""How well the views support columns."""

from collections.abc import Iterator
from typing import NamedTuple, Self

import cv2
import numpy as np

from geometry.arrays import BoolArray, FloatArray, FloatMap, IntArray
from geometry.grid import lever_gate
from locate.fusion.search.columns import Columns, PlumeColumn
from locate.fusion.views import Views

FOOTPRINT_SHARE = 0.85
"""Half width of the outline that is summed, in radii of the column; chosen by hand."""
NEAREST_DEPTH_UNITS = 0.5
"""Nothing closer to a camera than this is scored, units of fusion; chosen by hand."""
EXPLAINED_RADII = 1.5
"""How far from its axis a plume explains evidence, in radii; chosen by hand."""
MASK_HEIGHTS = np.linspace(-0.1, 1.1, 25)
"""Heights of the corners of a masked outline, in heights of the column; chosen by hand."""
AGREEING_VIEWS = 3
"""No view counts for more than the one of this rank; chosen by hand."""
CONTRAST_EXPONENT = 0.75
"""Of the number of samples that a column's evidence is divided by: 0 is the sum, 1 the mean; set on
four flights of the simulated campaign (docs/archive/tried.md)."""
LEAST_SAMPLES = 1e-6
"""Keeps the contrast of a column that no view shows finite."""
SAMPLES_AT_ONCE = 100_000
"""Pixels sampled before all views at once: bounds the memory, the scores do not depend on it."""
ALONG, ACROSS = 14, 5
"""Samples of an outline along the axis and across it; chosen by hand."""
OUTSIDE_PX = -1e4
"""A pixel coordinate outside every frame, for points behind a camera."""


def score_columns(views: Views, columns: Columns, *, along: int = ALONG) -> FloatArray:
    """(V, N) evidence of each view for each column, nats.

    Sums over the column's outline (its side, foreshortened, and its end), gated by what can be seen
    there, counted in independent samples (one per `Views.correlation_px2`).

    Args:
        views: The evidence.
        columns: N columns.
        along: Samples along the axis.
    """
    sampled = _sample_outlines(views, columns, along)
    return np.concatenate([outlines.sum(outlines.read(views.llr)) for outlines in sampled])


def sum_over_outlines(
    views: Views, columns: Columns, *, along: int = ALONG
) -> tuple[FloatArray, FloatArray]:
    """As `score_columns`, and (V, N) the number of independent samples that hold evidence.

    Where it is known what a plume would bring (`Views.foreseen`), they count in proportion to it.
    """
    nats, samples = [], []
    for outlines in _sample_outlines(views, columns, along):
        llr = outlines.read(views.llr)
        nats.append(outlines.sum(llr))
        counted = llr != 0 if views.foreseen is None else outlines.read(views.foreseen)
        samples.append(outlines.sum(counted))
    return np.concatenate(nats), np.concatenate(samples)


class _ColumnOutlines(NamedTuple):
    """N columns at S heights.

    Attributes:
        points: (3, S * N) of the axes.
        half_widths: (S, N) of the outline there.
        directions: (3, N) unit vectors of the axes.
        slab: (N,) length of axis that a height stands for.
    """

    points: FloatArray
    half_widths: FloatArray
    directions: FloatArray
    slab: FloatArray

    @classmethod
    def of_columns(cls, columns: Columns, along: int) -> Self:
        heights = columns.heights * (np.arange(along)[:, None] + 0.5) / along
        axes = np.stack([*columns.slopes.T, np.ones(len(columns))])
        lengths = np.linalg.norm(axes, axis=0)
        return cls(
            points=columns.axis_points(heights.T).T.reshape(3, -1),
            half_widths=FOOTPRINT_SHARE * (columns.radii + columns.openings * heights),
            directions=axes / lengths,
            slab=columns.heights * lengths / along,
        )


class _SampledOutlines(NamedTuple):
    """Where some views show the outlines of columns.

    Axes of arrays: view, sample across (A), sample along (S), column (N).

    Attributes:
        rows: Which of the views.
        x: (V, A, S, N) pixels that are sampled.
        y: Likewise.
        gate: (V, A, S, N) weight of their evidence.
        area: (V, S, N) independent samples that each stands for.
    """

    rows: slice
    x: FloatMap
    y: FloatMap
    gate: FloatMap
    area: FloatArray

    def read(self, maps: FloatMap) -> FloatMap:
        """(V, A, S, N) values of all views' maps at the pixels, 0 outside."""
        return _sample_nearest(maps[self.rows], self.x, self.y, outside=0.0)

    def sum(self, values: FloatMap) -> FloatArray:
        """(V, N) sums of (V, A, S, N) values at the pixels, in independent samples."""
        return np.asarray(((values * self.gate).sum(axis=1) * self.area).sum(axis=1))


def _sample_outlines(views: Views, columns: Columns, along: int) -> Iterator[_SampledOutlines]:
    """The outlines in so many views at once that they stay in the processor's cache."""
    outlines = _ColumnOutlines.of_columns(columns, along)
    across_axis = np.linspace(-1, 1, ACROSS, dtype=np.float32)
    at_once = max(1, SAMPLES_AT_ONCE // max(1, len(columns) * along * ACROSS))
    for start in range(0, len(views), at_once):
        yield _project_outlines(views, slice(start, start + at_once), outlines, across_axis)


def _project_outlines(
    views: Views, rows: slice, outlines: _ColumnOutlines, across_axis: FloatMap
) -> _SampledOutlines:
    """The outlines in some views."""
    points, half_widths, directions, slab = outlines
    focal = views.trajectory.camera.focal_px
    center_x, center_y = views.trajectory.camera.matrix[:2, 2]
    nearest = NEAREST_DEPTH_UNITS * views.unit
    rotations = views.trajectory.rotations[rows]
    in_cam = rotations @ points + views.trajectory.translations[rows, :, None]
    in_cam = in_cam.reshape(len(rotations), 3, *half_widths.shape)
    ahead = in_cam[:, 2] > nearest
    depth = np.maximum(in_cam[:, 2], nearest)
    scale = focal / depth
    half_px = half_widths * scale
    middle_x = np.where(ahead, in_cam[:, 0] * scale + center_x, OUTSIDE_PX).astype(np.float32)
    middle_y = (in_cam[:, 1] * scale + center_y).astype(np.float32)
    x = middle_x[:, None] + half_px.astype(np.float32)[:, None] * across_axis[:, None, None]
    y = np.repeat(middle_y[:, None], len(across_axis), axis=1)
    background = _sample_nearest(views.inverse_depth[rows], x, y, outside=np.nan)
    facing = np.abs(np.einsum("vksn,vkn->vsn", in_cam, rotations @ directions))
    facing /= np.sqrt(np.einsum("vksn,vksn->vsn", in_cam, in_cam))
    area = 2 * half_px * slab * scale * np.sqrt(np.maximum(1 - facing**2, 0))
    area += np.pi * half_px**2 * facing / len(half_widths)
    area /= len(across_axis) * views.correlation_px2
    return _SampledOutlines(
        rows=rows,
        x=x,
        y=y,
        gate=lever_gate(depth.astype(np.float32)[:, None], background),
        area=area,
    )


def _sample_nearest(maps: FloatMap, x: FloatMap, y: FloatMap, *, outside: float) -> FloatMap:
    """(V, A, S, N) values of (V, H, W) maps at the pixels nearest to x and y."""
    views, across, along, columns = x.shape
    found = np.empty((views, across * along, columns), np.float32)
    if not columns:
        return found.reshape(x.shape)
    for image, at_x, at_y, out in zip(
        maps, x.reshape(found.shape), y.reshape(found.shape), found, strict=True
    ):
        cv2.remap(image, at_x, at_y, cv2.INTER_NEAREST, dst=out, borderValue=outside)
    return found.reshape(x.shape)


def clipped_sum(nats: FloatArray) -> FloatArray:
    """(N,) sum of (V, N) evidence in which no view counts for more than the third strongest.

    A column close to one camera fills its frame; without this its clutter alone would carry it.
    """
    rank = min(AGREEING_VIEWS, len(nats))
    limit = np.partition(nats, -rank, axis=0)[-rank]
    return np.asarray(np.minimum(nats, limit).sum(axis=0))


def column_evidence(views: Views, columns: Columns) -> FloatArray:
    """(N,) evidence of all views together for N columns, nats."""
    return clipped_sum(score_columns(views, columns))


def column_contrast(views: Views, columns: Columns) -> FloatArray:
    """(N,) how clearly N columns stand out of what is around them, in no unit of note.

    The sum over views of S / n^0.75, for S nats in n samples. It is largest for a plume's own
    outline: whatever holds less than three quarters of the mean inside lessens it, so that a gap
    between plumes does, where the evidence against a plume may be too weak by itself.
    """
    nats, samples = sum_over_outlines(views, columns)
    return clipped_sum(
        np.maximum(nats, 0) / np.maximum(samples, LEAST_SAMPLES) ** CONTRAST_EXPONENT
    )


def supporting_pixels(views: Views, column: PlumeColumn) -> BoolArray:
    """(V, H, W) the pixels inside a column's outline with evidence for a plume."""
    return np.asarray((views.llr > 0) & (mask_out(views, column, radii=1.0).llr == 0))


def mask_out(views: Views, column: PlumeColumn, *, radii: float = EXPLAINED_RADII) -> Views:
    """The views without evidence and information inside a column's outline, `radii` wide.

    What one plume explains must not support another.
    """
    llr = views.llr.copy()
    information = list(views.information)
    for i, polygon in _outline_polygons(views, column, radii):
        cv2.fillPoly(llr[i], [polygon], 0.0)
        if information:
            information[i] = information[i].without(polygon)
    return views.with_evidence(llr, tuple(information))


def explained_pixels(views: Views, column: PlumeColumn) -> BoolArray:
    """(V, H, W) the pixels whose evidence `mask_out` takes away."""
    pixels = np.zeros(views.llr.shape, np.uint8)
    for i, polygon in _outline_polygons(views, column, EXPLAINED_RADII):
        cv2.fillPoly(pixels[i], [polygon], 1)
    return pixels.astype(bool)


def _outline_polygons(
    views: Views, column: PlumeColumn, radii: float
) -> Iterator[tuple[int, IntArray]]:
    """The corners, px, of a column's outline, `radii` wide, in each view that it is before."""
    wide = column.widened(radii)
    heights = MASK_HEIGHTS * column.height
    points = wide.axis_points(heights)
    half_widths = np.maximum(wide.radius + wide.opening * heights, wide.radius / 2)
    for i in range(len(views)):
        in_cam = views.trajectory.world_to_cam(i, points)
        pixels = views.trajectory.camera.project(in_cam)
        ahead = in_cam[:, 2] > 0
        if not ahead.any():
            continue
        half = views.trajectory.camera.focal_px * half_widths[ahead] / in_cam[ahead, 2]
        sideways = np.stack([half, np.zeros_like(half)], axis=1)
        outline = np.concatenate([pixels[ahead] - sideways, (pixels[ahead] + sideways)[::-1]])
        yield i, np.rint(outline).astype(np.int32)
