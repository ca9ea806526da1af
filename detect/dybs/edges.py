"""The displacement of straight edges, by how far they are from straight: nothing is learned.

An edge's points are found to a small part of a pixel along the axis that it crosses more steeply,
linked to their neighbours, and compared with a straight line: one through most of the edge's own
points, and one of the direction that most edges around share, as those of a wall in perspective do.
What lies off the line is taken for displacement across it. A displacement that is the same along
all of an edge is lost, and one along the edge is never seen.
"""

import cv2
import numpy as np

from detect.dybs.edge_points import NEAREST_PX, EdgePoints, estimate_camera_noise
from detect.dybs.edge_reliability import edge_moments, reliable_areas
from detect.dybs.line_deviations import LineDeviations
from geometry.arrays import FloatMap, GreyImage

FARTHEST_PX = 1.5
POOL_PX = 3.0
ACROSS = 0.03
LONGEST_PX = 128.0
SUMS = 12


def measure_edges(image: GreyImage) -> FloatMap:
    """Measures the edges of an image, at half resolution.

    Args:
        image: (H, W) grey values.

    Returns:
        (H/2, W/2, 9), rounded up: displacement px x, y off the shared lines; the same off their
        own; information xx, xy, yy, 1 / px^2; how long the edges are, 1 at 128 px; 1 where they
        are reliable. Zeros far from edges.
    """
    sums = np.zeros((SUMS, *[(side + 1) // 2 for side in image.shape]), np.float32)
    if min(image.shape) <= 2 * NEAREST_PX:
        return np.zeros((*sums.shape[1:], 9), np.float32)
    grey = image.astype(np.float32)
    noise = estimate_camera_noise(grey)
    for axis, seen in enumerate((grey, np.ascontiguousarray(grey.T))):
        points = EdgePoints.find(seen, noise)
        if len(points.edge):
            sums += _sum_by_cell(points, LineDeviations.fit(points), axis, sums.shape[1:])
    pooled = _pool_sums(sums[:8])
    reliable = reliable_areas(pooled[:2], sums[8:])
    return np.asarray(cv2.merge([*pooled, reliable.astype(np.float32)]))


def _sum_by_cell(
    points: EdgePoints, off: LineDeviations, axis: int, shape: tuple[int, ...]
) -> FloatMap:
    """(12, *shape) sums over each cell's points: 8 of their certainty, and their moments."""
    across = 1 / np.hypot(1, off.tilt)
    x, y, places = across, -across * off.tilt, (points.place, points.line)
    if axis:
        x, y, places = y, x, places[::-1]
    certain = (np.abs(off.own) < FARTHEST_PX) / off.variance
    shared, own = -off.shared * across, -off.own * across
    long = np.log(off.length) / np.log(LONGEST_PX)
    values = [x * shared, y * shared, x * own, y * own, x * x, x * y, y * y, long]
    parts = [certain * part for part in values] + edge_moments((x, y), off.floor, off.variance)
    column, row = (np.rint(place).astype(np.intp) // 2 for place in places)
    cells = row * shape[1] + column
    sums = [np.bincount(cells, part, shape[0] * shape[1]) for part in parts]
    return np.array(sums, np.float32).reshape(-1, *shape)


def _pool_sums(sums: FloatMap) -> list[FloatMap]:
    """(8, h, w) what edges near each pixel measure together; across them alone if parallel.

    Args:
        sums: (8, h, w) of `_sum_by_cell`.
    """
    area = np.float32(np.pi * POOL_PX**2)
    pooled = [np.asarray(cv2.GaussianBlur(part, (0, 0), POOL_PX / 2) * area) for part in sums]
    *offsets, xx, xy, yy, long = pooled
    ridge = ACROSS * (xx + yy) + 1e-6
    determinant = (xx + ridge) * (yy + ridge) - xy * xy
    solved = [
        part / determinant
        for right, down in (offsets[:2], offsets[2:])
        for part in ((yy + ridge) * right - xy * down, (xx + ridge) * down - xy * right)
    ]
    return [*solved, xx, xy, yy, long / (xx + yy + 1e-6)]
