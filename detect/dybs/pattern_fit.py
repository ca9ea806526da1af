"""Whether an image is a lattice: all of it by its waves and their harmonics, or not."""

from collections.abc import Iterator
from itertools import accumulate, repeat
from operator import mul

import numpy as np

from detect.dybs.waves import ComplexMap
from geometry.arrays import FloatArray, FloatMap

ORDER = 3
ROUNDS = 2
OUTLIER, ODD = 3.0, 4.0
VISIBLE = 0.4
"""Share of the pattern's own contrast below which no departure is odd: a plume makes such."""
MEDIAN_OF_SQUARE = 0.455
RIDGE = 1e-6


def pattern_misfit(
    grey: FloatMap,
    at: FloatMap,
    phasors: ComplexMap,
    frequencies: FloatArray,
    *,
    inside: FloatMap,
    noise: float,
) -> tuple[float, float]:
    """How far grey levels depart from a constant pattern of the phases, under uneven light.

    Args:
        grey: (N,) grey levels of some pixels.
        at: (3, N) 1, x, y of each.
        phasors: (Q, N) e^(i phase) of each wave, as measured.
        frequencies: (Q, 2) of the waves, cycles per px; what no camera shows is left out.
        inside: (N,) 1 where the lattice is, 0 elsewhere.
        noise: Of the camera, grey levels.

    Returns:
        The share of the pixels that depart by more than 4 times the median and visibly; the median
        squared departure above the noise, in those of the pattern itself.
    """
    slow = [at, *((at * part) for z in phasors for part in (z.real, z.imag))]
    fast = [
        part[None] for z in _harmonic_phasors(phasors, frequencies) for part in (z.real, z.imag)
    ]
    design = np.concatenate([*slow, *fast]).astype(np.float32)
    weights, member = inside, inside > 0
    for _ in range(ROUNDS):
        weighted = design * weights
        normal = weighted @ design.T
        normal += RIDGE * np.trace(normal) * np.eye(len(normal), dtype=np.float32)
        found = np.linalg.solve(normal, weighted @ grey).astype(np.float32)
        errors = np.abs(grey - found @ design)[member]
        median = float(np.median(errors)) + 1e-3
        weights = inside.copy()
        weights[member] /= 1 + (errors / (OUTLIER * median)) ** 2
    own = np.median(np.abs(grey - found[:3] @ at)[member]) + 1e-4
    unexplained = max(median**2 - MEDIAN_OF_SQUARE * noise**2, 0) / own**2
    return float(np.mean(errors > max(ODD * median, VISIBLE * own))), float(unexplained)


def _harmonic_phasors(phasors: ComplexMap, frequencies: FloatArray) -> Iterator[ComplexMap]:
    """e^(i phase) of sums and differences of up to three of the waves' phases."""
    powers = [list(accumulate(repeat(z, ORDER), mul, initial=np.ones_like(z))) for z in phasors]
    for first in range(ORDER + 1):
        rest = ORDER - first if len(phasors) > 1 else 0
        for second in range(-rest, rest + 1):
            multiples = np.array([first, second][: len(phasors)])
            mirrored = first == 0 and second <= 0
            alone = first + abs(second) == 1
            if mirrored or alone or np.abs(multiples @ frequencies).max() > 0.5:
                continue
            other = powers[-1][abs(second)] if len(phasors) > 1 else 1
            yield powers[0][first] * (other if second >= 0 else np.conj(other))
