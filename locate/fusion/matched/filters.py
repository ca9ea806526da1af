"""Every view filtered with the turn that the displacement makes across the axis of a plume.

Across a column of warm air the displacement is antisymmetric: it points away from the axis on both
sides (towards it for a denser gas), grows up to about a radius and fades. Each view's normal
equations are filtered with either half of that turn, for widths and directions as they occur, which
gives how many sigmas each side shows at every pixel. Added over heights and views, a turn far below
the noise of any pixel stands out. The sides are kept apart, as a pole of a wrong depth looks
displaced as well, but to one side of the axis alone.
"""

from dataclasses import dataclass

import cv2
import numpy as np

from detect.information import DisplacementInformation
from geometry.arrays import FloatArray, FloatMap, IntArray
from geometry.grid import lever_gate
from geometry.normal_errors import MAD_TO_SIGMA
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
SOME_ROWS = 80
"""About so many rows of a view, and as many columns of each, show how its sigmas scatter."""
SIDES = 2


@dataclass(frozen=True, kw_only=True)
class TurnSamples:
    """What V views show at M points of axes.

    Attributes:
        sigmas: (2, V, M) by how many sigmas the displacement turns on either side, positive where
            it points away from the axis; at most `MOST_SIGMAS`.
        weight: (V, M) how much of a turn the view would show there, from 0 to 1: little before
            a near background, nothing where no displacement is known.
        sigmas_per_px: (2, V, M) what a turn would show whose size is 1 px.
    """

    sigmas: FloatMap
    weight: FloatMap
    sigmas_per_px: FloatMap


class TurnFilters:
    """The filtered views, made as they are needed.

    Args:
        views: With information.
    """

    def __init__(self, views: Views) -> None:
        self.views = views
        self._filtered = [FilteredView(information) for information in views.information]
        self._across = _common_direction(views)

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
        for i, filtered in enumerate(self._filtered):
            seen, in_cam, pixel = self._project(i, points)
            depth = in_cam[:, 2]
            size_px = self.views.trajectory.camera.focal_px * widths[seen] / depth
            step = np.rint(2 * np.log2(size_px / NARROWEST_PX)).astype(np.int64)
            shown = (step >= 0) & (step < WIDTHS)
            if not shown.any():
                continue
            seen, in_cam, pixel, depth = seen[shown], in_cam[shown], pixel[shown], depth[shown]
            normal = self._normal(i, in_cam, rises[seen])
            found = filtered.look_up(step[shown], normal, pixel)
            gate = lever_gate(
                depth.astype(np.float32), self.views.inverse_depth[i][pixel[:, 1], pixel[:, 0]]
            )
            sigmas[:, i, seen], per_px[:, i, seen] = found
            weight[i, seen] = gate * (found[1] > 0).any(axis=0)
        return TurnSamples(sigmas=sigmas, weight=weight, sigmas_per_px=per_px)

    def _project(self, i: int, points: FloatArray) -> tuple[IntArray, FloatArray, IntArray]:
        """Which of the points a view shows, where they are before its camera, and their pixels."""
        trajectory = self.views.trajectory
        in_cam = trajectory.world_to_cam(i, points)
        near = NEAREST_DEPTH_UNITS * self.views.unit
        ahead = np.flatnonzero(in_cam[:, 2] > near)
        in_cam = in_cam[ahead]
        pixel = np.rint(trajectory.camera.project(in_cam))
        height, width = self.views.llr.shape[1:]
        inside = ((pixel >= 0) & (pixel < [width, height])).all(axis=1)
        return ahead[inside], in_cam[inside], pixel[inside].astype(np.int64)

    def _normal(self, i: int, in_cam: FloatArray, rises: FloatArray) -> FloatArray:
        """(M,) angle across the axis in a view, from x to y; towards the same side in all views."""
        rotation = self.views.trajectory.rotations[i]
        along = rises @ rotation.T
        along = along[:, :2] - in_cam[:, :2] / in_cam[:, 2:] * along[:, 2:]
        normal: FloatArray = np.arctan2(along[:, 0], -along[:, 1])
        if rotation[0] @ self._across < 0:
            normal += np.pi
        return normal


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
        self._table = np.empty((self._ends[-1], 2, SIDES), np.float16)
        self._filled = np.zeros(len(cells), np.bool_)
        self._information = information
        self._summed: dict[int, tuple[FloatMap, ...]] = {}

    def look_up(self, steps: IntArray, normals: FloatArray, pixels: IntArray) -> FloatMap:
        """(2, 2, M) sigmas, and sigmas per px, of either side at M pixels; 0 if unknown.

        Args:
            steps: (M,) which of the widths.
            normals: (M,) angle across the axis, from x to y.
            pixels: (M, 2) x and y.
        """
        turns = np.rint(normals / (np.pi / DIRECTIONS)).astype(np.int64) % (2 * DIRECTIONS)
        codes = steps * DIRECTIONS + turns % DIRECTIONS
        for code in np.unique(codes[~self._filled[codes]]).tolist():
            self._fill(code)
        x, y = pixels.T >> steps // 2
        x = np.minimum(x, self._widths[steps] - 1)
        y = np.minimum(y, self._heights[steps] - 1)
        found = self._table.take(self._starts[codes] + y * self._widths[steps] + x, axis=0)
        turned = turns >= DIRECTIONS
        found[turned] = found[turned, :, ::-1]
        return np.asarray(np.moveaxis(found, 0, -1), np.float32)

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
        part = self._table[self._starts[code] : self._ends[code]]
        for k, one_side in enumerate((side > 0, side < 0)):
            for row, filtered in enumerate(_filter_side(across, precision, turn * one_side)):
                part[:, row, k] = filtered.ravel()
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


def turn_kernel(width_px: float, angle_rad: float) -> tuple[FloatMap, FloatMap, FloatArray]:
    """The turn across an axis.

    Args:
        width_px: From the axis to the largest displacement.
        angle_rad: Of the direction across, from x to y.

    Returns:
        (K, K) the displacement along that direction at the pixels round the axis; (K, K) how far
        along it they are; (2,) the direction.
    """
    reach = int(np.ceil(REACH * width_px))
    y, x = np.mgrid[-reach : reach + 1, -reach : reach + 1] / width_px
    direction = np.array([np.cos(angle_rad), np.sin(angle_rad)])
    off = x * direction[0] + y * direction[1]
    along = (y * direction[0] - x * direction[1]) / LENGTH_SHARE
    return (off * np.exp(-(off**2 + along**2) / 2)).astype(np.float32), off, direction


def _filter_side(
    across: FloatMap, precision: FloatMap, kernel: FloatMap
) -> tuple[FloatMap, FloatMap]:
    """(h, w) sigmas of one side in units of their scatter over the view, and sigmas per px."""
    score = cv2.filter2D(across, -1, kernel, borderType=cv2.BORDER_CONSTANT)
    variance = cv2.filter2D(precision, -1, kernel * kernel, borderType=cv2.BORDER_CONSTANT)
    some = (slice(None, None, max(1, round(len(score) / SOME_ROWS))),) * 2
    known = variance > LEAST_KNOWN * max(float(np.percentile(variance[some], 90)), 1e-9)
    root = np.sqrt(np.maximum(variance, np.float32(1e-9)))
    sigmas = score / root * known
    scatter = np.float32(scatter_of(sigmas[some][known[some]]))
    clipped = (sigmas / scatter).clip(-MOST_SIGMAS, MOST_SIGMAS)
    return clipped, root / scatter * known


def scatter_of(values: FloatArray | FloatMap, fewest: int = 30) -> float:
    """The standard deviation of values about zero, outliers apart; 1 where they are too few."""
    if values.size < fewest:
        return 1.0
    return max(MAD_TO_SIGMA * float(np.median(np.abs(values))), 1e-3)


def _common_direction(views: Views) -> FloatArray:
    """(3,) the world direction that lies most along the rows of all views."""
    rows = views.trajectory.rotations[:, 0]
    return np.asarray(np.linalg.eigh(rows.T @ rows)[1][:, -1])
