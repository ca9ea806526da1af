"""Every view filtered with the turn that the displacement makes across the axis of a plume.

Across a column of warm air the displacement is antisymmetric: it points away from the axis on both
sides (towards it for a denser gas), grows up to about a radius and fades. Each view's normal
equations are filtered with either half of that turn, for widths and directions as they occur, which
gives how many sigmas each side shows at every pixel. Added over heights and views, a turn far below
the noise of any pixel stands out. The sides are kept apart, as a pole of a wrong depth looks
displaced as well, but to one side of the axis alone.
"""

import math
from dataclasses import dataclass
from typing import NamedTuple

import cv2
import numpy as np

from detect.information import DisplacementInformation
from geometry.arrays import FloatArray, FloatMap, IntArray
from geometry.grid import lever_gate
from geometry.mapped_array import map_array
from geometry.normal_errors import MAD_TO_SIGMA, quick_quantile
from locate.fusion.search.score import NEAREST_DEPTH_UNITS
from locate.fusion.views import Views

NARROWEST_PX, WIDTHS = 1.5, 9
"""Least distance from the axis to the largest displacement, px of the maps, and how many widths
there are, each sqrt(2) times the one before; chosen by hand."""
DIRECTIONS = 16
"""Directions across an axis in the image, over half a turn; chosen by hand."""
LENGTH_SHARE = 2.0
"""Standard deviation of the filter along the axis, in its widths; chosen by hand."""
REACH = 3.0
"""Half side of the filter, in its widths; what is beyond has no weight."""
LEAST_KNOWN = 0.05
"""Of the information that the best tenth of a view holds: less counts as none; chosen by hand."""
MOST_SIGMAS = 3.0
"""No side of any place counts for more: an edge with a wrong depth is no plume; chosen by hand."""
MOST_STORED = 6e4
"""Sigmas that a table of half precision holds."""
SOME_ROWS = 80
"""About so many rows of a view, and as many columns of each, show how its sigmas scatter."""
FEWEST_VALUES = 30
"""Values from which their scatter is measured; chosen by hand."""
SIDES = 2


@dataclass(frozen=True, kw_only=True)
class TurnSamples:
    """What V views show at M points of axes.

    Attributes:
        sigmas: (2, V, M) by how many sigmas the displacement turns on either side, positive where
            it points away from the axis.
        weight: (V, M) how much of a turn the view would show there, from 0 to 1: little before
            a near background, nothing where no displacement is known.
        sigmas_per_px: (2, V, M) what a turn would show whose size is 1 px.
    """

    sigmas: FloatMap
    weight: FloatMap
    sigmas_per_px: FloatMap

    @property
    def limited(self) -> FloatMap:
        """(2, V, M) `sigmas`, none beyond `MOST_SIGMAS`."""
        return np.asarray(self.sigmas.clip(-MOST_SIGMAS, MOST_SIGMAS))


class TurnFilters:
    """The filtered views, made as they are needed.

    Args:
        views: With information.
    """

    def __init__(self, views: Views) -> None:
        self.views = views
        self._filtered = [FilteredView(information) for information in views.information]
        self._across = _common_direction(views)
        matrix = views.trajectory.camera.matrix
        self._focal_px, self._center_px = matrix.diagonal()[:2, None], matrix[:2, 2, None]

    def sample(self, points: FloatArray, widths: FloatArray, rises: FloatArray) -> TurnSamples:
        """What the views show at points of axes.

        Args:
            points: (M, 3) in the world.
            widths: (M,) from the axis to the largest displacement, world units.
            rises: (M, 3) along the axes.
        """
        shape = (len(self.views), len(points))
        sigmas, per_px = np.zeros((2, SIDES, *shape), np.float32)
        weight = np.zeros(shape, np.float32)
        by_axis, width = np.ascontiguousarray(points.T), self.views.llr.shape[2]
        for i, filtered in enumerate(self._filtered):
            shown = self._project(i, by_axis, widths)
            if not len(shown.point):
                continue
            normal = self._normal(i, shown, rises.take(shown.point, axis=0))
            found = filtered.look_up(shown.step, normal, shown.x, shown.y)
            background = self.views.inverse_depth[i].take(shown.y * width + shown.x)
            gate = lever_gate(shown.depth, background)
            sigmas[:, i, shown.point], per_px[:, i, shown.point] = found
            weight[i, shown.point] = gate * ((found[1, 0] > 0) | (found[1, 1] > 0))
        return TurnSamples(sigmas=sigmas, weight=weight, sigmas_per_px=per_px)

    def _project(self, i: int, points: FloatArray, widths: FloatArray) -> "_ShownPoints":
        """Where a view shows (3, M) points, of axes with turns of (M,) widths."""
        trajectory = self.views.trajectory
        nearest = NEAREST_DEPTH_UNITS * self.views.unit
        in_cam = trajectory.rotations[i] @ points + trajectory.translations[i][:, None]
        depth = in_cam[2]
        ahead = depth > nearest
        far = np.maximum(depth, nearest)
        beside = in_cam[:2] / far
        pixel = np.rint(beside * self._focal_px + self._center_px)
        step = np.rint(2 * np.log2(trajectory.camera.focal_px / NARROWEST_PX * widths / far))
        height, width = self.views.llr.shape[1:]
        shown = ahead & (step >= 0) & (step < WIDTHS)
        shown &= (pixel[0] >= 0) & (pixel[0] < width) & (pixel[1] >= 0) & (pixel[1] < height)
        point = np.flatnonzero(shown)
        x, y = pixel.take(point, axis=1).astype(np.int64)
        return _ShownPoints(
            point=point,
            x=x,
            y=y,
            step=step.take(point).astype(np.int64),
            depth=depth.take(point).astype(np.float32),
            beside=beside.take(point, axis=1),
        )

    def _normal(self, i: int, shown: "_ShownPoints", rises: FloatArray) -> FloatArray:
        """(M,) angle across the axis in a view, from x to y; towards the same side in all views."""
        rotation = self.views.trajectory.rotations[i]
        along = rotation @ rises.T
        x, y = along[:2] - shown.beside * along[2]
        normal: FloatArray = np.arctan2(x, -y)
        if rotation[0] @ self._across < 0:
            normal += np.pi
        return normal


class _ShownPoints(NamedTuple):
    """M points that a view shows.

    Attributes:
        point: (M,) which of those asked for.
        x: (M,) pixel.
        y: Likewise.
        step: (M,) which of the widths of the filters.
        depth: (M,) along the optical axis, world units.
        beside: (2, M) x and y before the camera, in depths.
    """

    point: IntArray
    x: IntArray
    y: IntArray
    step: IntArray
    depth: FloatMap
    beside: FloatArray


class FilteredView:
    """One view filtered with turns of all widths and directions, each when it is needed.

    The filtered maps follow each other in one table, so that places of all of them are looked up
    at once.

    Args:
        information: Of the view.
    """

    def __init__(self, information: DisplacementInformation) -> None:
        height, width = information.vector.shape[:2]
        halvings = np.arange(WIDTHS) // 2
        self._widths = np.maximum(width >> halvings, 1)
        self._heights = np.maximum(height >> halvings, 1)
        cells = np.repeat(self._widths * self._heights, DIRECTIONS)
        self._ends = np.cumsum(cells)
        self._starts = self._ends - cells
        self._table = map_array((int(self._ends[-1]), 2, SIDES), np.float16)
        self._filled = np.zeros(len(cells), np.bool_)
        self._information = information
        self._summed: dict[int, tuple[FloatMap, ...]] = {}

    def look_up(self, steps: IntArray, normals: FloatArray, x: IntArray, y: IntArray) -> FloatMap:
        """(2, 2, M) sigmas, and sigmas per px, of either side at M pixels; 0 if unknown.

        Args:
            steps: (M,) which of the widths.
            normals: (M,) angle across the axis, from x to y.
            x: (M,) of the pixels.
            y: Likewise.
        """
        turns = np.rint(normals / (np.pi / DIRECTIONS)).astype(np.int64) % (2 * DIRECTIONS)
        codes = steps * DIRECTIONS + turns % DIRECTIONS
        wanted = np.zeros_like(self._filled)
        wanted[codes] = True
        for code in np.flatnonzero(wanted & ~self._filled).tolist():
            self._fill(code)
        halvings, widths = steps // 2, self._widths[steps]
        x = np.minimum(x >> halvings, widths - 1)
        y = np.minimum(y >> halvings, self._heights[steps] - 1)
        cells = self._table.take(self._starts[codes] + y * widths + x, axis=0)
        planes = np.ascontiguousarray(cells.reshape(len(cells), -1).T)
        # OpenCV reads half precision 15 times as fast as numpy.
        found = cv2.add(planes, 0.0, dtype=cv2.CV_32F).reshape(2, SIDES, -1)
        return np.asarray(np.where(turns >= DIRECTIONS, found[:, ::-1], found))

    def _fill(self, code: int) -> None:
        """Filters the view for one width and direction."""
        step, direction = divmod(code, DIRECTIONS)
        size_px = NARROWEST_PX * 2 ** (step / 2)
        halvings = step // 2
        x, y, xx, xy, yy = self._sum_cells(halvings)
        turn, side, (cx, cy) = turn_kernel(size_px / 2**halvings, np.pi * direction / DIRECTIONS)
        across = cx * x + cy * y
        precision = cx * cx * xx + 2 * cx * cy * xy
        precision += cy * cy * yy
        sides = [_filter_side(across, precision, turn * each) for each in (side > 0, side < 0)]
        (first, first_per_px), (second, second_per_px) = sides
        maps = cv2.merge([first, second, first_per_px, second_per_px])
        part = self._table[self._starts[code] : self._ends[code]]
        part[:] = cv2.add(maps, 0.0, dtype=cv2.CV_16F).reshape(part.shape)
        self._filled[code] = True

    def _sum_cells(self, halvings: int) -> tuple[FloatMap, ...]:
        """(h, w) x and y of the vector, xx, xy and yy of the matrix, in cells of 2^halvings px."""
        if halvings not in self._summed:
            cells = self._information
            if halvings:
                size = (int(self._widths[2 * halvings]), int(self._heights[2 * halvings]))
                cells = cells.summed_to(*size)
            self._summed[halvings] = (*cv2.split(cells.vector), *cv2.split(cells.matrix))
        return self._summed[halvings]


def turn_kernel(
    width_px: float, angle_rad: float
) -> tuple[FloatMap, FloatMap, tuple[float, float]]:
    """The turn across an axis.

    Args:
        width_px: From the axis to the largest displacement.
        angle_rad: Of the direction across, from x to y.

    Returns:
        (K, K) the displacement along that direction at the pixels round the axis; (K, K) how far
        along it they are; the x and y of the direction.
    """
    reach = int(np.ceil(REACH * width_px))
    y, x = np.mgrid[-reach : reach + 1, -reach : reach + 1] / width_px
    # Plain floats: numpy's own would make every map of float32 that they touch float64.
    direction = math.cos(angle_rad), math.sin(angle_rad)
    off = x * direction[0] + y * direction[1]
    along = (y * direction[0] - x * direction[1]) / LENGTH_SHARE
    return (off * np.exp(-(off**2 + along**2) / 2)).astype(np.float32), off, direction


def _filter_side(
    across: FloatMap, precision: FloatMap, kernel: FloatMap
) -> tuple[FloatMap, FloatMap]:
    """(h, w) sigmas of one side in units of their scatter over the view, and sigmas per px."""
    score, variance = _correlate(across, kernel), _correlate(precision, kernel * kernel)
    some = (slice(None, None, max(1, round(len(score) / SOME_ROWS))),) * 2
    known = variance > LEAST_KNOWN * max(quick_quantile(variance[some], 0.9), 1e-9)
    root = np.sqrt(np.maximum(variance, np.float32(1e-9), out=variance), out=variance)
    sigmas = np.divide(score, root, out=score)
    sigmas *= known
    scatter = np.float32(scatter_of(sigmas[some][known[some]]))
    sigmas /= scatter
    root /= scatter
    root *= known
    return sigmas.clip(-MOST_STORED, MOST_STORED, out=sigmas), root


def _correlate(image: FloatMap, kernel: FloatMap) -> FloatMap:
    """The correlation of (h, w) with (K, K), nothing around it.

    The upper and the lower half of the kernel by themselves: OpenCV sums those that are so small
    directly, without the zeros that most of a kernel for one side consists of.
    """
    middle = len(kernel) // 2
    upper, lower = kernel[: middle + 1], kernel[middle:].copy()
    lower[0] = 0.0
    total = cv2.filter2D(image, -1, upper, anchor=(middle, middle), borderType=cv2.BORDER_CONSTANT)
    total += cv2.filter2D(image, -1, lower, anchor=(middle, 0), borderType=cv2.BORDER_CONSTANT)
    return np.asarray(total)


def scatter_of(values: FloatArray | FloatMap) -> float:
    """The standard deviation of values about zero, outliers apart; 1 where they are too few."""
    if values.size < FEWEST_VALUES:
        return 1.0
    return max(MAD_TO_SIGMA * quick_quantile(np.abs(values), 0.5), 1e-3)


def _common_direction(views: Views) -> FloatArray:
    """(3,) the world direction that lies most along the rows of all views."""
    rows = views.trajectory.rotations[:, 0]
    return np.asarray(np.linalg.eigh(rows.T @ rows)[1][:, -1])
