"""Which sightings of several flights are of one hotspot, and where the hotspots are.

The model: the foot of a column is where its hotspot is, off by chance by `wander_m` each way,
and downwind of it by a length times how far the columns of that flight lean. That length is one
for the whole survey, and unknown; so is each flight's offset, known to the covariance of its
georeference. Sightings of one flight are of different hotspots.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.cluster.hierarchy import fcluster, linkage
from scipy.special import betaln

from geometry.arrays import FloatArray, IntArray
from locate.survey.frame import FlightOffset, PlumeSighting
from locate.survey.graph import GraphSolution, SharedCorrections, solve_graph

APART = 1e6
"""Cost, nats, of two sightings of one flight in one group: never."""
SAME = 0.5
"""Prior probability that a sighting is of a given other flight's hotspot; chosen."""


@dataclass(frozen=True, kw_only=True)
class AssociatedHotspots:
    """Hotspots and what belongs to them.

    Attributes:
        hotspot_of: (N,) index of the hotspot of each sighting, from 0.
        solution: Their positions, with the offsets of the flights.
    """

    hotspot_of: IntArray
    solution: GraphSolution


def associate(
    sightings: Sequence[PlumeSighting],
    offsets: Sequence[FlightOffset],
    leans: FloatArray,
    *,
    wander_m: float,
    area_m2: float,
) -> AssociatedHotspots:
    """Groups sightings, solves for their hotspots, and merges hotspots that prove to be one.

    Args:
        sightings: N of them.
        offsets: Of the F flights.
        leans: (F, 2) of the columns of each flight, the survey's mean taken out.
        wander_m: Standard deviation of the foot of a hotspot's column about it.
        area_m2: Of the ground that was covered.
    """
    density = max(len(sightings), 1) / max(len(offsets), 1) / area_m2
    groups = group_sightings(sightings, SharedCorrections.prior(offsets), leans, wander_m, density)
    solution = solve_graph(sightings, groups, offsets, leans, wander_m)
    while pairs := find_same_hotspots(sightings, groups, solution, density):
        groups = _merge_groups(groups, pairs)
        solution = solve_graph(sightings, groups, offsets, leans, wander_m)
    return AssociatedHotspots(hotspot_of=groups, solution=solution)


def find_same_hotspots(
    sightings: Sequence[PlumeSighting], groups: IntArray, solution: GraphSolution, density: float
) -> list[tuple[int, int]]:
    """Pairs of hotspots that are likelier one than two; of each hotspot only its likeliest.

    Two that no flight saw both of would share the flights out between them, and any way of that is
    as likely: the more flights, the more this speaks for one. Without it the two halves into which
    chance parts the sightings of one are, by their means, plainly two.
    """
    count = len(solution.positions)
    saw = np.zeros((count, 1 + max((one.flight for one in sightings), default=0)), dtype=bool)
    saw[groups, [one.flight for one in sightings]] = True
    each = np.arange(count)
    alone, shared = solution.covariances[:, :2, :2], solution.joint[:, :, :2, :2]
    covariance = alone[:, None] + alone - shared - shared.swapaxes(0, 1)
    covariance[each, each] = np.eye(2)
    apart = (solution.positions[:, None] - solution.positions)[..., :2]
    odds = _log_density(apart, covariance) - np.log(density / SAME)
    one, other = saw.sum(axis=1)[:, None], saw.sum(axis=1)
    odds -= betaln(one + 1, other + 1) + np.log(one + other + 1)  # log of one + other over other
    odds[saw.astype(int) @ saw.T > 0] = -np.inf
    likely = [(k, other) for k, other in np.argwhere(odds > 0).tolist() if k < other]
    likely.sort(key=lambda pair: -odds[pair])
    pairs: list[tuple[int, int]] = []
    paired: set[int] = set()
    for pair in likely:
        if paired.isdisjoint(pair):
            pairs.append(pair)
            paired.update(pair)
    return pairs


def _merge_groups(groups: IntArray, pairs: list[tuple[int, int]]) -> IntArray:
    joined = groups.copy()
    for kept, gone in pairs:
        joined[groups == gone] = kept
    return np.unique(joined, return_inverse=True)[1].astype(np.int64)


def group_sightings(
    sightings: Sequence[PlumeSighting],
    shared: SharedCorrections,
    leans: FloatArray,
    wander_m: float,
    density: float,
) -> IntArray:
    """(N,) groups, numbered as they come: sightings that one hotspot explains better than two.

    A sighting is of the hotspot of another flight's sighting with probability `SAME`, and then
    differs from it by their errors; or it is one of the others, anywhere on the covered ground.
    Complete linkage: all pairs of a group must agree.

    Args:
        sightings: N of them.
        shared: What is known of the offsets and the drift.
        leans: As of `associate`.
        wander_m: Likewise.
        density: How many a flight sees, per square metre.
    """
    if len(sightings) < 2:
        return np.zeros(len(sightings), dtype=np.int64)
    even = np.log(density / SAME)
    cost = even - _log_densities(sightings, shared, leans, wander_m)
    flights = np.array([one.flight for one in sightings])
    cost[np.concatenate([flights[i] == flights[i + 1 :] for i in range(len(flights))])] = APART
    lowest = min(float(cost.min()), 0.0)
    # Linkage wants distances: shifted to be positive, and cut where the odds are even.
    labels = fcluster(linkage(cost - lowest, "complete"), -lowest, "distance")
    _, first, groups = np.unique(labels, return_index=True, return_inverse=True)
    return np.asarray(np.argsort(np.argsort(first))[groups], dtype=np.int64)


def _log_densities(
    sightings: Sequence[PlumeSighting],
    shared: SharedCorrections,
    leans: FloatArray,
    wander_m: float,
) -> FloatArray:
    """Log density of the horizontal difference of two sightings of one hotspot, 1 / m^2.

    Returns:
        (N (N - 1) / 2,) of each pair once: of the first with all others, of the second with those
        after it, and so on. One sighting at a time, as whole matrices of pairs take much memory.
    """
    position, unsure = shared.correct_positions(sightings, leans)
    single = np.array([one.own_covariance for one in sightings]) + unsure
    single = single[:, :2, :2] + wander_m**2 * np.eye(2)
    lean = leans[[one.flight for one in sightings]]
    densities = []
    for i in range(len(sightings)):
        turned = shared.drift_sigma_m * (lean[i] - lean[i + 1 :])
        covariance = single[i] + single[i + 1 :] + turned[:, :, None] * turned[:, None, :]
        densities.append(_log_density((position[i] - position[i + 1 :])[:, :2], covariance))
    return np.concatenate(densities)


def _log_density(difference: FloatArray, covariance: FloatArray) -> FloatArray:
    """Log of a normal density in the plane at (..., 2) with (..., 2, 2), 1 / m^2."""
    scaled = np.linalg.solve(covariance, difference[..., None])[..., 0]
    squared = (difference * scaled).sum(axis=-1)
    return np.asarray(-0.5 * (squared + np.log(np.linalg.det(covariance))) - np.log(2 * np.pi))
