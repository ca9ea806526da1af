"""Where along its axis a plume begins.

Displacement grows with the distance from plume to background, so it fades where the ground is
close behind the base: the lowest evidence lies above the source. The source is therefore sought
between that end and the surface which the axis meets below it, with the evidence against
every height in between. Where something nearer covers the axis first, the surface is not
seen, and every height down to the lowest background is as likely.

A height belongs to the plume where it shows about as much as the plume does further up, pixel for
pixel. That is less than it takes to be a plume rather than none: evidence also leaks below the
source, and where the surface is close nothing can be seen. In some plumes the evidence along the
axis misleads; so it never rules a height out.
"""

from dataclasses import dataclass

import numpy as np

from geometry.arrays import FloatArray
from geometry.grid import relative_lever
from geometry.normal_errors import MAD_TO_SIGMA, MEDIAN_SPREAD
from locate.fusion.search.columns import PlumeColumn
from locate.fusion.search.score import score_columns, sum_over_outlines
from locate.fusion.views import Views

STEP_UNITS = 0.02
"""Spacing of the heights that are tried, units of fusion; chosen by hand."""
REACH_BELOW_UNITS = 3.0
"""How far below the column's lowest point a source is sought, units of fusion; chosen by hand."""
CONTACT_LEVER = 0.02
"""Lever from which on downwards the axis touches the surface; chosen by hand."""
OCCLUDER_LEVER = -0.06
"""Lever below which something nearer covers the axis; chosen by hand."""
EDGE_STEPS = 2
"""Samples next to an edge that are left out, as the depths of two surfaces mix there; by hand."""
COVER_EDGE_UNITS = 0.1
"""A contact must be this far below the cover's edge, units of fusion; chosen by hand."""
FEWEST_CONTACTS = 2
"""Views in which the axis must meet the surface; chosen by hand."""
INDEPENDENT_VIEWS = 0.5
"""Share of the views whose contacts count as independent; chosen by hand."""
SURFACE_PRIOR = 0.7
"""Probability that a plume begins at the surface its axis meets; as the next four, set on 25
plumes of `benchmarks.reliability` (docs/archive/tried.md)."""
CORE_SHARE = 0.5
"""Of a column's radius, within which heights are compared: a plume is narrow where it begins."""
BELONGING_SHARE = 0.5
"""Of a plume's own evidence for each sample of a view, from which on a height belongs to it."""
INDEPENDENT_SHARE = 0.16
"""Share of the evidence along the axis that counts as independent."""
MISLED_SHARE = 0.05
"""Probability that the evidence along the axis does not depend on the source."""


@dataclass(frozen=True, kw_only=True)
class PlumeBase:
    """The beginning of a plume along its axis.

    Attributes:
        height: Of the source above the column's lowest point, along world Z; often negative.
        sigma: Its standard deviation, world units.
        evidence_low: Height where evidence begins.
        evidence_high: Height where it ends.
        hidden: Something nearer covers the lower end in most views.
    """

    height: float
    sigma: float
    evidence_low: float
    evidence_high: float
    hidden: bool


@dataclass(frozen=True, kw_only=True)
class SurfaceContact:
    """Where the axis meets a surface, or is covered.

    Attributes:
        height: Above the column's lowest point, along world Z.
        sigma: Its standard deviation.
        found: It touches a surface there; otherwise this is only the lowest height it could.
        hidden: Something nearer covers it in most views.
    """

    height: float
    sigma: float
    found: bool
    hidden: bool


def locate_base(views: Views, column: PlumeColumn) -> PlumeBase:
    """The height of the source and its sigma, given the evidence along the axis."""
    step = STEP_UNITS * views.unit
    heights = np.arange(-REACH_BELOW_UNITS * views.unit, column.height + views.unit, step)
    slabs = column.cut_slabs(heights, step)
    low, high, middle = _evidence_interval(
        heights, score_columns(views, slabs, along=1).sum(axis=0)
    )
    contact = find_contact(views, column, heights[heights <= middle], step)
    inside = (heights >= contact.height) & (heights <= middle)
    candidates = np.concatenate([[contact.height], heights[inside]])
    # 1. How likely the evidence is for each height: what lies above belongs to the plume.
    core = column.widened(CORE_SHARE).cut_slabs(heights, step)
    evidence, samples = (each.sum(axis=0) for each in sum_over_outlines(views, core, along=1))
    upper = (heights > middle) & (heights <= high)
    typical = max(float(evidence[upper].sum()) / max(float(samples[upper].sum()), 1e-9), 0.0)
    belonging = evidence - BELONGING_SHARE * typical * samples
    above = np.cumsum(belonging[::-1])[::-1] * INDEPENDENT_SHARE
    log_likelihood = np.interp(candidates, heights, above)
    likelihood = _normalise(np.exp(log_likelihood - log_likelihood.max()))
    # 2. How likely each is before.
    uniform = (1 - SURFACE_PRIOR) / max(len(candidates) - 1, 1)
    at_surface = SURFACE_PRIOR if contact.found else uniform
    prior = np.r_[at_surface, np.full(len(candidates) - 1, uniform)]
    # 3. The mean by this evidence, and the spread about it, as it may mislead.
    mean = float(_normalise(prior * likelihood) @ candidates)
    misled = MISLED_SHARE / len(candidates)
    weight = _normalise(prior * ((1 - MISLED_SHARE) * likelihood + misled))
    variance = float(weight @ (candidates - mean) ** 2)
    variance += float(weight[0]) * contact.sigma**2 + float(weight[1:].sum()) * step**2 / 12
    return PlumeBase(
        height=mean,
        sigma=float(np.sqrt(variance)),
        evidence_low=low,
        evidence_high=high,
        hidden=contact.hidden,
    )


def _normalise(weight: FloatArray) -> FloatArray:
    return np.asarray(weight / weight.sum())


def _evidence_interval(heights: FloatArray, evidence: FloatArray) -> tuple[float, float, float]:
    """The run of heights with the largest summed evidence, and the one that halves its sum."""
    cumulative = np.concatenate([[0.0], np.cumsum(evidence)])
    lowest_so_far = np.minimum.accumulate(cumulative[:-1])
    last = int(np.argmax(cumulative[1:] - lowest_so_far))
    first = last - int(np.argmin(cumulative[last::-1]))
    half = (cumulative[first] + cumulative[last + 1]) / 2
    middle = first + int(np.argmax(cumulative[first + 1 : last + 2] >= half))
    return float(heights[first]), float(heights[last]), float(heights[middle])


def find_contact(
    views: Views, column: PlumeColumn, heights: FloatArray, step: float
) -> SurfaceContact:
    """Where the axis, followed downwards, meets a surface, or the lowest height where it may.

    A view in which the lever falls to nearly zero sees the axis touch the surface, where a
    straight line through the last two levers is zero; nearly, for an axis that is a little too near
    must not miss a pipe. A view in which the lever jumps to well below zero sees something nearer
    that covers the axis. Where most do, only views that see past it can see a touch: what seems one
    at the height of its edge is a mixture of depths.

    Args:
        views: The evidence with the inverse depth of the background.
        column: The column.
        heights: (S,) ascending, from below any surface up to the middle of the evidence.
        step: Their spacing, world units.
    """
    points = column.axis_points(heights)
    contacts: list[float] = []
    covers: list[float] = []
    for i in range(len(views)):
        levers = _axis_levers(views, i, points)
        behind = np.flatnonzero(levers <= CONTACT_LEVER)
        if not len(behind) or behind[-1] + 1 >= len(levers):
            continue
        j = behind[-1]
        above, below = levers[j + 1], levers[j]
        if not np.isfinite(above):
            continue
        crossing = float(heights[j] - step * below / (above - below))
        (covers if _edge_lever(levers, j) < OCCLUDER_LEVER else contacts).append(crossing)
    hidden = len(covers) > len(contacts)
    if hidden:
        past_the_cover = float(np.median(covers)) - COVER_EDGE_UNITS * views.unit
        contacts = [contact for contact in contacts if contact < past_the_cover]
    if len(contacts) < FEWEST_CONTACTS:
        lowest = max(heights[0], min(views.lowest_background - column.lowest_z, heights[-1]))
        return SurfaceContact(height=float(lowest), sigma=step, found=False, hidden=hidden)
    crossings = np.array(contacts)
    height = float(np.median(crossings))
    spread = float(MAD_TO_SIGMA * np.median(np.abs(crossings - height)))
    independent = len(crossings) * INDEPENDENT_VIEWS
    sigma = MEDIAN_SPREAD * np.hypot(spread, step / np.sqrt(12)) / np.sqrt(independent)
    return SurfaceContact(height=height, sigma=float(sigma), found=True, hidden=hidden)


def _edge_lever(levers: FloatArray, j: int) -> float:
    """The lever on the surface below sample `j`, continued up to it.

    Zero where that surface touches the axis, whatever its slope. The samples next to `j` are left
    out: there the depths of two surfaces mix.
    """
    near, far = levers[max(j - EDGE_STEPS, 0)], levers[max(j - 2 * EDGE_STEPS, 0)]
    continued = 2 * near - far
    return float(continued if np.isfinite(continued) else levers[j])


def _axis_levers(views: Views, i: int, points: FloatArray) -> FloatArray:
    """(S,) lever of axis points in one view; NaN outside the frame."""
    in_cam = views.trajectory.world_to_cam(i, points)
    pixel = np.rint(views.trajectory.camera.project(in_cam))
    height, width = views.llr.shape[1:]
    inside = np.all((pixel >= 0) & (pixel < [width, height]), axis=1)
    x, y = np.where(inside[:, None], pixel, 0).astype(int).T
    depth = in_cam[:, 2].astype(np.float32)
    levers = relative_lever(depth, views.inverse_depth[i][y, x]).astype(float)
    levers[~inside] = np.nan
    return levers
