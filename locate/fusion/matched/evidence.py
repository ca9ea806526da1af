"""Evidence of each pixel for one turn, from which its source and its extent are taken."""

import numpy as np

from geometry.arrays import FloatArray, FloatMap, IntArray
from geometry.grid import lever_gate
from locate.fusion.matched.filters import REACH
from locate.fusion.matched.fit import Turn
from locate.fusion.search.columns import PlumeColumn
from locate.fusion.search.score import NEAREST_DEPTH_UNITS
from locate.fusion.views import Views

AXIS_POINTS = 60
"""Points of an axis to which pixels are assigned; chosen by hand."""
CORRELATION_PX2 = 150.0
"""Area over which evidence counts as correlated where no view has any: with 60 the sections of weak
turns showed no axis. Set on leaks of real strength 13000 to 13006 (docs/accuracy.md)."""
BELOW_UNITS = 1.0
"""How far below its lowest point the axis is continued, units of fusion; chosen by hand."""


def with_turn_evidence(views: Views, turn: Turn) -> Views:
    """The views, those without evidence with the evidence of their pixels for one turn.

    That is the log-likelihood ratio of a turn of the size that all views together show against
    none. All of them together have half the square of its sigmas, as errors that neighbouring
    pixels share make the sum of what each states too large.

    Where no view has evidence of pixels, what each pixel would bring is foreseen: where something
    moves or there is no texture a turn shows little, which is not evidence against it.
    """
    predicted = np.stack([_predict_turn(views, i, turn.column) for i in range(len(views))])
    vector = np.stack([each.vector for each in views.information])
    matrix = np.stack([each.matrix for each in views.information])
    x, y = np.moveaxis(predicted, -1, 0)
    score = x * vector[..., 0] + y * vector[..., 1]
    variance = x * x * matrix[..., 0] + 2 * x * y * matrix[..., 1] + y * y * matrix[..., 2]
    size_px = score.sum() / max(float(variance.sum()), 1e-9)
    mean_llr = size_px**2 / 2 * variance
    llr = size_px * score - mean_llr
    total = max(float(llr.sum()), 1e-9)
    nats = turn.sigmas**2 / 2
    empty = ~views.llr.any(axis=(1, 2), keepdims=True)
    correlation_px2 = CORRELATION_PX2 if empty.all() else views.correlation_px2
    factor = nats / total * correlation_px2
    turning = (llr * factor).astype(np.float32)
    return views.with_evidence(
        np.where(empty, turning, views.llr),
        correlation_px2=correlation_px2,
        foreseen=(mean_llr * factor).astype(np.float32) if empty.all() else None,
    )


def _predict_turn(views: Views, i: int, column: PlumeColumn) -> FloatMap:
    """(H, W, 2) the displacement of a turn of size 1, away from the axis."""
    trajectory = views.trajectory
    height, width = views.llr.shape[1:]
    predicted = np.zeros((height, width, 2), np.float32)
    low = -BELOW_UNITS * views.unit
    heights = np.linspace(low, column.height, AXIS_POINTS)
    in_cam = trajectory.world_to_cam(i, column.axis_points(heights))
    if (in_cam[:, 2] < NEAREST_DEPTH_UNITS * views.unit).any():
        return predicted
    axis = trajectory.camera.project(in_cam)
    widths = column.radii_at(heights)
    widths_px = trajectory.camera.focal_px * widths / in_cam[:, 2]
    tangent = axis[-1] - axis[0]
    tangent /= max(float(np.linalg.norm(tangent)), 1e-9)
    normal = np.array([-tangent[1], tangent[0]])
    rows, columns = _window(axis, REACH * float(widths_px.max()), (height, width))
    pixels = np.stack(np.meshgrid(columns, rows), axis=-1)
    if not pixels.size:
        return predicted
    along = (pixels - axis[0]) @ tangent
    place = np.interp(along, (axis - axis[0]) @ tangent, np.arange(AXIS_POINTS), -1, -1)
    nearest = np.rint(place).clip(0).astype(np.int64)
    off = ((pixels - axis[nearest]) @ normal) / widths_px[nearest]
    gate = lever_gate(
        in_cam[nearest, 2].astype(np.float32), views.inverse_depth[i][np.ix_(rows, columns)]
    )
    size = off * np.exp(-(off**2) / 2) * gate * (place >= 0) * (np.abs(off) < REACH)
    predicted[np.ix_(rows, columns)] = size[..., None] * normal
    return predicted


def _window(axis: FloatArray, reach: float, shape: tuple[int, int]) -> tuple[IntArray, IntArray]:
    """The rows and columns of pixels near an axis in the image."""
    (left, top), (right, bottom) = axis.min(axis=0) - reach, axis.max(axis=0) + reach
    rows = np.arange(max(0, int(top)), min(shape[0], int(bottom) + 1))
    columns = np.arange(max(0, int(left)), min(shape[1], int(right) + 1))
    return rows, columns
