"""How far the points of edges lie off the straight lines that they should be on.

There are two such lines: one through most of an edge's own points, and one of the direction that
most edges of a block share, as those of a wall in perspective do.
"""

from dataclasses import dataclass
from typing import Self

import numpy as np

from detect.dybs.edge_points import EdgePoints, Indices
from geometry.arrays import FloatArray

MISFIT_PX = 0.02
BLOCK_PX = 160
"""Side of the blocks whose edges share a pencil of directions."""
AGREES_PX = 0.5
OUTLIER = 1.5
ROUNDS = 5
LAG, MOST_BENT_PX = 3, 2.0


@dataclass(frozen=True, kw_only=True)
class LineDeviations:
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
    def fit(cls, points: EdgePoints) -> Self:
        """Fits the lines by iteratively reweighted least squares with Cauchy's weights."""
        edge = points.edge
        length = np.bincount(edge).astype(float)
        middle, level = (np.bincount(edge, v) / length for v in (points.line, points.place))
        at, off = points.line - middle[edge], points.place - level[edge]
        floor = points.sigma_px**2 + MISFIT_PX**2
        own, own_tilt = _fit_own_lines(at, off, 1 / floor, edge)
        variance = np.maximum(floor, _roughness(own, edge) + MISFIT_PX**2)
        places = np.stack([level // BLOCK_PX, middle // BLOCK_PX])
        blocks = np.unique(places, axis=1, return_inverse=True)[1].ravel()
        shared, tilt = _fit_pencils(
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


def _fit_own_lines(
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
        weights = trust * _cauchy_weights(rest, weights, edge)
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


def _fit_pencils(
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
        most = OUTLIER * _group_medians(np.abs(rest), of_block) + MISFIT_PX
        weights = trust / (1 + (rest / most) ** 2)
    return rest, first[blocks] + second[blocks] * level


def _group_medians(sizes: FloatArray, group: Indices) -> FloatArray:
    """(N,) the median size in the group that each belongs to."""
    return np.array([np.median(sizes[group == k]) for k in range(group.max() + 1)])[group]


def _cauchy_weights(rest: FloatArray, weights: FloatArray, group: Indices) -> FloatArray:
    """Weights that fall where `rest` is above what it mostly is in its group."""
    variance = np.bincount(group, weights * rest**2) / np.bincount(group, weights)
    return np.asarray(1 / (1 + rest**2 / (variance + MISFIT_PX**2)[group]))
