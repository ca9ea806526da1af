"""The displacement of straight edges, by how far they are from straight: nothing is learned.

An edge's points are found to a small part of a pixel along the axis that it crosses more steeply,
linked to their neighbours, and compared with a straight line: one through most of the edge's own
points, and one of the direction that most edges around share, as those of a wall in perspective do.
What lies off the line is taken for displacement across it. A displacement that is the same along
all of an edge is lost, and one along the edge is never seen.
"""

from dataclasses import dataclass
from typing import Self

import cv2
import numpy as np

from detect.dybs.points import NEAREST_PX, Indices, Points, camera_noise
from detect.dybs.sound import sound, witness
from geometry.arrays import FloatArray, FloatMap, GreyImage

MISFIT_PX = 0.02
FARTHEST_PX = 1.5
BLOCK_PX = 160
"""Side of the blocks whose edges share a pencil of directions."""
AGREES_PX = 0.5
OUTLIER = 1.5
ROUNDS = 5
LAG, MOST_BENT_PX = 3, 2.0
POOL_PX = 3.0
ACROSS = 0.03
LONGEST_PX = 128.0
SUMS = 12


@dataclass(frozen=True, kw_only=True)
class Departures:
    """How far N points lie off the line that their edge should be, px along the axis.

    Attributes:
        own: (N,) off the edge's own line.
        shared: (N,) off the line of the pencil, where the edge agrees with it; else as `own`.
        tilt: (N,) of that line, px along the axis per row or column.
        length: (N,) points of the edge.
        floor: (N,) px^2 variance of these by the camera's noise.
        variance: (N,) the same, or by how rough the edge is where that is more.
    """

    own: FloatArray
    shared: FloatArray
    tilt: FloatArray
    length: FloatArray
    floor: FloatArray
    variance: FloatArray

    @classmethod
    def of(cls, points: Points) -> Self:
        """Fits the lines by iteratively reweighted least squares with Cauchy's weights."""
        edge = points.edge
        length = np.bincount(edge).astype(float)
        middle, level = (np.bincount(edge, v) / length for v in (points.line, points.place))
        at, off = points.line - middle[edge], points.place - level[edge]
        floor = points.sigma_px**2 + MISFIT_PX**2
        own, own_tilt = _off_own_lines(at, off, 1 / floor, edge)
        variance = np.maximum(floor, _roughness(own, edge) + MISFIT_PX**2)
        places = np.stack([level // BLOCK_PX, middle // BLOCK_PX])
        blocks = np.unique(places, axis=1, return_inverse=True)[1].ravel()
        shared, tilt = _off_pencils(
            at, off, 1 / variance, edge, level % BLOCK_PX / BLOCK_PX, blocks
        )
        agrees = np.abs(tilt - own_tilt) * length < 4 * AGREES_PX
        return cls(
            own=own,
            shared=np.where(agrees[edge], shared, own),
            tilt=np.where(agrees, tilt, own_tilt)[edge],
            length=length[edge],
            floor=floor,
            variance=variance,
        )


def straightness(image: GreyImage) -> FloatMap:
    """What the edges of an image say, at half resolution.

    Args:
        image: (H, W) grey values.

    Returns:
        (H/2, W/2, 9), rounded up: displacement px x, y off the shared lines; the same off their
        own; information xx, xy, yy, 1 / px^2; how long the edges are, 1 at 128 px; 1 where they
        may be believed. Zeros far from edges.
    """
    sums = np.zeros((*[(side + 1) // 2 for side in image.shape], SUMS), np.float32)
    if min(image.shape) <= 2 * NEAREST_PX:
        return sums[..., :9]
    grey = image.astype(np.float32)
    noise = camera_noise(grey)
    for axis, seen in enumerate((grey, np.ascontiguousarray(grey.T))):
        points = Points.find(seen, noise)
        if len(points.edge):
            sums += _summed(points, Departures.of(points), axis, sums.shape[:2])
    said, witnessed = np.split(sums, [8], axis=-1)
    pooled = _pooled(said)
    return np.dstack([pooled, sound(pooled[..., :2], witnessed)])


def _off_own_lines(
    at: FloatArray, off: FloatArray, trust: FloatArray, edge: Indices
) -> tuple[FloatArray, FloatArray]:
    """(N,) off the line through most of an edge's points; (E,) its tilt."""
    weights = trust
    for _ in range(ROUNDS):
        one, x, xx, y, xy = (
            np.bincount(edge, weights * part) for part in (1, at, at * at, off, at * off)
        )
        determinant = one * xx - x * x + 1e-9
        tilt = (one * xy - x * y) / determinant
        rest = off - ((xx * y - x * xy) / determinant)[edge] - tilt[edge] * at
        weights = trust * _cauchy(rest, weights, edge)
    return rest, tilt


def _roughness(off: FloatArray, edge: Indices) -> FloatArray:
    """(N,) variance, px^2, of what is bent within a few px on a point's edge: no plume is so fine.

    Args:
        off: (N,) px off a straight line, points of an edge in the order they have along it.
        edge: (N,) to which edge the points belong.
    """
    order = np.argsort(edge, kind="stable")
    along, of = off[order], edge[order]
    first, middle, last = slice(None, -2 * LAG), slice(LAG, -LAG), slice(2 * LAG, None)
    same = of[last] == of[first]
    bent = (along[first] - 2 * along[middle] + along[last])[same]
    count = np.bincount(of[middle][same], minlength=of[-1] + 1)
    total = np.bincount(of[middle][same], np.minimum(bent**2, MOST_BENT_PX**2), of[-1] + 1)
    return np.asarray((total / (6 * np.maximum(count, 1)))[edge])


def _off_pencils(
    at: FloatArray,
    off: FloatArray,
    trust: FloatArray,
    edge: Indices,
    level: FloatArray,
    blocks: Indices,
) -> tuple[FloatArray, FloatArray]:
    """(N,) off the lines of a pencil: their tilt is linear in (E,) `level`; (E,) that tilt.

    Args:
        at: (N,) px along the lines, from the middle of each edge.
        off: (N,) px across them.
        trust: (N,) weights.
        edge: (N,) to which edge the points belong.
        level: (E,) where the edges lie across the lines.
        blocks: (E,) which edges share a pencil.
    """
    weights, of_block = trust, blocks[edge]
    for _ in range(ROUNDS):
        total = np.bincount(edge, weights)
        y, a, b = (
            part - (np.bincount(edge, weights * part) / total)[edge]
            for part in (off, at, at * level[edge])
        )
        aa, ab, bb, ay, by = (
            np.bincount(of_block, weights * part) for part in (a * a, a * b, b * b, a * y, b * y)
        )
        ridged = bb + 1e-3 * aa + 1e-9
        determinant = aa * ridged - ab * ab + 1e-9
        first, second = (ridged * ay - ab * by) / determinant, (aa * by - ab * ay) / determinant
        rest = y - first[of_block] * a - second[of_block] * b
        most = OUTLIER * _medians(np.abs(rest), of_block) + MISFIT_PX
        weights = trust / (1 + (rest / most) ** 2)
    return rest, first[blocks] + second[blocks] * level


def _medians(sizes: FloatArray, group: Indices) -> FloatArray:
    """(N,) the median size in the group that each belongs to."""
    return np.array([np.median(sizes[group == k]) for k in range(group.max() + 1)])[group]


def _cauchy(rest: FloatArray, weights: FloatArray, group: Indices) -> FloatArray:
    """Weights that fall where `rest` is above what it mostly is in its group."""
    variance = np.bincount(group, weights * rest**2) / np.bincount(group, weights)
    return np.asarray(1 / (1 + rest**2 / (variance + MISFIT_PX**2)[group]))


def _summed(points: Points, off: Departures, axis: int, shape: tuple[int, ...]) -> FloatMap:
    """(*shape, 12) sums over each cell's points: 8 times their certainty, and their `witness`."""
    across = 1 / np.hypot(1, off.tilt)
    x, y, places = across, -across * off.tilt, (points.place, points.line)
    if axis:
        x, y, places = y, x, places[::-1]
    certain = (np.abs(off.own) < FARTHEST_PX) / off.variance
    shared, own = -off.shared * across, -off.own * across
    long = np.log(off.length) / np.log(LONGEST_PX)
    said = [x * shared, y * shared, x * own, y * own, x * x, x * y, y * y, long]
    parts = [certain * part for part in said] + witness((x, y), off.floor, off.variance)
    column, row = (np.rint(place).astype(np.intp) // 2 for place in places)
    cells = row * shape[1] + column
    sums = [np.bincount(cells, part, shape[0] * shape[1]) for part in parts]
    return np.stack(sums, axis=-1).reshape(*shape, -1).astype(np.float32)


def _pooled(sums: FloatMap) -> FloatMap:
    """What edges near each pixel say together; across them alone where all run one way."""
    pooled = cv2.GaussianBlur(sums, (0, 0), POOL_PX / 2) * np.float32(np.pi * POOL_PX**2)
    xx, xy, yy, long = np.moveaxis(pooled[..., 4:], -1, 0)
    ridge = ACROSS * (xx + yy) + 1e-6
    determinant = (xx + ridge) * (yy + ridge) - xy * xy
    solved = [
        part / determinant
        for right, down in (np.moveaxis(pooled[..., k : k + 2], -1, 0) for k in (0, 2))
        for part in ((yy + ridge) * right - xy * down, (xx + ridge) * down - xy * right)
    ]
    return np.stack([*solved, xx, xy, yy, long / (xx + yy + 1e-6)], axis=-1).astype(np.float32)
