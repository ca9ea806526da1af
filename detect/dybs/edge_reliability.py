"""Which straight edges are reliable: those around them are parallel, smooth, and undisplaced.

A plume bends parts of a few edges, smoothly and by more than a camera's noise can. Where most edges
around are bent, or rough within a few px, it is the thing itself that is not straight, as nearly
everywhere in photos; and where edges cross, they disturb each other. A small area may pass all of
this by chance.
"""

from collections.abc import Sequence

import cv2
import numpy as np

from geometry.arrays import BoolArray, FloatArray, FloatMap

WINDOW = 49
"""Side of the surroundings of a pixel, at half the image's resolution."""
MOST_ROUGH_PX, ROUGHEST_PX = 0.03, 0.2
LEAST_PARALLEL = 0.9
STILL_PX, LEAST_STILL = 0.08, 0.65
BROAD, CLOSE = 28, 17
"""Sides of the square that a reliable area must hold, and of that around each of its pixels which
counts with it, at half the image's resolution."""
EMPTY = 1e-6


def edge_moments(
    across: Sequence[FloatArray], floor: FloatArray, variance: FloatArray
) -> list[FloatArray]:
    """Direction and roughness of (N,) points of edges, to be summed over their surroundings.

    Args:
        across: Unit vector across the edge, x and y.
        floor: px^2, variance of the place by the camera's noise alone.
        variance: px^2, by noise or by roughness, whichever is more.
    """
    x, y = across
    return [x * x, x * y, y * y, np.minimum(variance - floor, ROUGHEST_PX**2)]


def reliable_areas(displacement: Sequence[FloatMap], sums: FloatMap) -> BoolArray:
    """(h, w) where the edges around are reliable.

    The limits were chosen on samples and photos of the training and the validation split.

    Args:
        displacement: (2, h, w) px, of the edges off straight lines.
        sums: (4, h, w) of `edge_moments`, over each cell's points.
    """
    still_points = (sums[0] + sums[2]) * (np.hypot(*displacement) < STILL_PX)
    xx, xy, yy, rough, calm = (
        cv2.boxFilter(part, -1, (WINDOW, WINDOW), borderType=cv2.BORDER_REFLECT)
        for part in (*sums, still_points)
    )
    points = xx + yy + EMPTY
    return np.asarray(
        (np.hypot(xx - yy, 2 * xy) > LEAST_PARALLEL * points)
        & (rough < MOST_ROUGH_PX**2 * points)
        & (calm > LEAST_STILL * points)
    )


def select_edges(straight: BoolArray, reliable: BoolArray, waves: BoolArray) -> BoolArray:
    """(h, w) which straight edges count: those of a broad reliable area, and those close to it.

    In photos what passes `reliable_areas` by chance is a spot or a thin strip along one edge;
    printed lines fill a wall, and do not pass where a plume bends most of them. The sides were
    chosen on samples and photos of the training and the validation split.

    Args:
        straight: (h, w) where there are straight edges.
        reliable: (h, w) by `reliable_areas`.
        waves: (h, w) where waves are measured, which make an area broad, too.
    """
    smooth = straight & reliable
    parts, part = cv2.connectedComponents((smooth | waves).astype(np.uint8))
    square = np.ones((BROAD, BROAD), np.uint8)
    inside = cv2.erode(
        (part > 0).astype(np.uint8), square, borderType=cv2.BORDER_CONSTANT, borderValue=0
    )
    broad = np.zeros(parts, dtype=bool)
    broad[part[inside > 0]] = True
    around = np.ones((CLOSE, CLOSE), np.uint8)
    close = cv2.dilate((smooth & broad[part]).astype(np.uint8), around)
    return np.asarray(straight & (close > 0))
