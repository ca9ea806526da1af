"""Where along its axis a plume begins.

Displacement grows with the distance from plume to background, so it fades where the ground is
close behind the base: the lowest evidence lies above the source. The source is therefore sought
between that end and the surface which the axis meets below it, with what the evidence says
against every height in between.
"""

from dataclasses import dataclass

import numpy as np

from geometry.arrays import FloatArray
from geometry.grid import lever
from locate.fusion.column import HEIGHT, score, slabs, spine
from locate.fusion.views import Views

STEP_UNITS = 0.02
REACH_BELOW_UNITS = 3.0
CONTACT_LEVER = 0.02
OCCLUDER_LEVER = -0.12
FEWEST_CONTACTS = 2
MEDIAN_SPREAD = 1.2533  # of a median against a mean, for normal errors
INDEPENDENT_VIEWS = 0.5
SURFACE_PRIOR = 0.8
LOOK_CORRELATION = 0.3


@dataclass(frozen=True, kw_only=True)
class Base:
    """The beginning of a plume along its axis.

    Attributes:
        height: Of the source above the column's lowest point, along world Z; often negative.
        sigma: Its standard deviation, world units.
        lowest_seen: Height where evidence begins.
        highest_seen: Height where it ends.
        hidden: Something nearer covers the lower end in most views.
    """

    height: float
    sigma: float
    lowest_seen: float
    highest_seen: float
    hidden: bool


@dataclass(frozen=True, kw_only=True)
class Contact:
    """Where the axis is lost from sight.

    Attributes:
        height: Above the column's lowest point, along world Z.
        sigma: Its standard deviation.
        found: It touches a surface there; otherwise this is only where something covers it, or
            the end of the search.
        hidden: Something nearer covers it in most views.
    """

    height: float
    sigma: float
    found: bool
    hidden: bool


def locate_base(views: Views, column: FloatArray, unit: float) -> Base:
    """The posterior mean and sigma of the source's height, given the evidence along the axis."""
    step = STEP_UNITS * unit
    heights = np.arange(-REACH_BELOW_UNITS * unit, column[HEIGHT] + unit, step)
    evidence = score(views, slabs(column, heights, step), along=1).sum(axis=0)
    low, high = _seen_interval(heights, evidence)
    contact = find_contact(views, column, heights[heights <= (low + high) / 2], step)
    if contact is None:
        contact = Contact(height=heights[0], sigma=step, found=False, hidden=False)
    inside = (heights >= contact.height) & (heights <= (low + high) / 2)
    candidates = np.concatenate([[contact.height], heights[inside]])
    above = np.cumsum(evidence[::-1])[::-1] * LOOK_CORRELATION
    likelihood = np.interp(candidates, heights, above)
    uniform = (1 - SURFACE_PRIOR) / max(len(candidates) - 1, 1)
    at_surface = SURFACE_PRIOR if contact.found else uniform
    prior = np.r_[at_surface, np.full(len(candidates) - 1, uniform)]
    weight = prior * np.exp(likelihood - likelihood.max())
    weight /= weight.sum()
    mean = float(weight @ candidates)
    variance = float(weight @ (candidates - mean) ** 2)
    variance += float(weight[0]) * contact.sigma**2 + step**2 / 12
    return Base(
        height=mean,
        sigma=float(np.sqrt(variance)),
        lowest_seen=low,
        highest_seen=high,
        hidden=contact.hidden,
    )


def _seen_interval(heights: FloatArray, evidence: FloatArray) -> tuple[float, float]:
    """The run of heights with the largest summed evidence."""
    cumulative = np.concatenate([[0.0], np.cumsum(evidence)])
    lowest_so_far = np.minimum.accumulate(cumulative[:-1])
    last = int(np.argmax(cumulative[1:] - lowest_so_far))
    first = last - int(np.argmin(cumulative[last::-1]))
    return float(heights[first]), float(heights[last])


def find_contact(
    views: Views, column: FloatArray, heights: FloatArray, step: float
) -> Contact | None:
    """Where the axis, followed downwards, meets a surface; None where it meets none.

    A view in which the lever falls to nearly zero sees the axis touch the surface, where a
    straight line through the last two levers is zero; nearly, for an axis that stands a little
    too near must not miss a pipe. A view in which the lever jumps far below zero sees something
    nearer that covers the axis.

    Args:
        views: The evidence with the inverse depth of the background.
        column: (8,) the column.
        heights: (S,) ascending, from below any surface up to the middle of the evidence.
        step: Their spacing, world units.
    """
    points = spine(column[None], heights[None])[0]
    contacts: list[float] = []
    covers: list[float] = []
    for i in range(len(views)):
        levers = _levers(views, i, points)
        behind = np.flatnonzero(levers <= CONTACT_LEVER)
        if not len(behind) or behind[-1] + 1 >= len(levers):
            continue
        j = behind[-1]
        above, below = levers[j + 1], levers[j]
        if not np.isfinite(above):
            continue
        crossing = float(heights[j] - step * below / (above - below))
        (covers if below < OCCLUDER_LEVER else contacts).append(crossing)
    found = len(contacts) >= FEWEST_CONTACTS
    crossings = np.array(contacts if found else covers)
    if not len(crossings):
        return None
    height = float(np.median(crossings))
    spread = float(1.4826 * np.median(np.abs(crossings - height)))
    independent = len(crossings) * INDEPENDENT_VIEWS
    sigma = MEDIAN_SPREAD * np.hypot(spread, step / np.sqrt(12)) / np.sqrt(independent)
    return Contact(
        height=height, sigma=float(sigma), found=found, hidden=len(covers) > len(contacts)
    )


def _levers(views: Views, i: int, points: FloatArray) -> FloatArray:
    """(S,) lever of axis points in one view; NaN outside the frame."""
    in_cam = views.trajectory.world_to_cam(i, points)
    pixel = np.rint(views.trajectory.camera.project(in_cam))
    height, width = views.llr.shape[1:]
    inside = np.all((pixel >= 0) & (pixel < [width, height]), axis=1)
    x, y = np.where(inside[:, None], pixel, 0).astype(int).T
    depth = in_cam[:, 2].astype(np.float32)
    levers = lever(depth, views.inverse_depth[i][y, x]).astype(float)
    levers[~inside] = np.nan
    return levers
