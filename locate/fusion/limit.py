"""The detection limit: the weakest plume that the evidence of a run could have shown."""

import numpy as np

from detect.evidence import LLR_MAX, LLR_MIN, log_likelihood_ratio
from detect.response import Response
from geometry.arrays import FloatMap
from locate.fusion.matched.plumes import RADIUS_WIDTHS, TurnSearch
from locate.fusion.matched.probability import passes
from locate.fusion.search.columns import HEIGHT, OPENING, RADIUS, Columns, X, Z
from locate.fusion.search.score import clipped_sum, score_columns
from locate.fusion.views import Views

AMPLITUDES_PX = np.geomspace(0.01, 3.0, 20)
"""Displacements that are tried, px of the original frames; chosen by hand."""
RANDOM_COLUMNS = 96
"""Places that are tried; chosen by hand."""
RADIUS_UNITS, USUAL_OPENING, HEIGHT_UNITS = 0.15, 0.1, 1.5
"""Shape of a usual plume: radius at its base and height in units of fusion; chosen by hand."""
RANGE_SHARES = (0.4, 0.8)
"""Where the places lie between camera and background, in ranges; chosen by hand."""
SHARE_SEEN = 0.5
"""Share of the places whose plume must pass the threshold: what defines the limit."""
FEWEST_VIEWS = 2.0
"""Views that must show a place; two give a position."""
LEAST_COVERAGE = 0.2
"""A view shows a place where its pixels there are this share of the most that any view has;
chosen by hand."""


TURN_PER_MEAN = 2.2
"""Size of a turn over the mean displacement inside it, where it has 0.3 of its largest and more."""
TURN_SHARE = 0.25
"""Of a plume's displacement that turns about a straight axis as its sigmas say; the rest is
turbulence. It was 0.4 to 1 in four simulated plants and 0.13 to 0.44 in five plumes on real frames,
which decide (docs/weak_plumes.md)."""


def detection_limit_px(
    views: Views,
    threshold_nats: float,
    *,
    response: Response | None = None,
    seed: int = 0,
    turns: TurnSearch | None = None,
) -> float | None:
    """The smallest displacement with which half of all places would have passed the threshold.

    Columns of a usual shape are put at random where at least two views show them, each pixel of
    them is given the evidence that the detector gives that displacement at its own sigma, and the
    sum is held against the threshold. Pixels without evidence (llr 0) keep none. Where turns are
    searched for, a column counts as well that shows enough of one.

    Args:
        views: The evidence of the run.
        threshold_nats: What counts as a plume.
        response: Of the detector; None: the hand-made formula.
        seed: Of the places.
        turns: The search for turns of the displacement, where there is one.

    Returns:
        px of the original frames, or None where even the largest of `AMPLITUDES_PX` would not
        have been seen.
    """
    pixels = views.by_pixels
    columns = _random_columns(pixels, np.random.default_rng(seed))
    observed = pixels.with_evidence(np.ones_like(pixels.llr))
    coverage = score_columns(observed, columns)
    columns = columns.take((coverage > LEAST_COVERAGE * coverage.max()).sum(axis=0) >= FEWEST_VIEWS)
    if not len(columns):
        return None
    narrow = Columns.of([column.widened(1 / RADIUS_WIDTHS) for column in columns])
    for amplitude in AMPLITUDES_PX:
        expected = pixels.with_evidence(expected_llr(pixels, float(amplitude), response))
        nats = clipped_sum(score_columns(expected, columns))
        if turns is None:
            seen = nats > threshold_nats
        else:
            size_px = TURN_SHARE * TURN_PER_MEAN * float(amplitude)
            seen = passes(turns.score.expected(narrow, size_px), nats / len(pixels))
        if seen.mean() >= SHARE_SEEN:
            return float(amplitude)
    return None


def _random_columns(views: Views, rng: np.random.Generator) -> Columns:
    """Columns between the cameras and the background."""
    background = views.background_in_world()
    target = background[rng.integers(len(background), size=RANDOM_COLUMNS)]
    centers = views.trajectory.centers_in_world
    center = centers[rng.integers(len(centers), size=RANDOM_COLUMNS)]
    share = rng.uniform(*RANGE_SHARES, (RANDOM_COLUMNS, 1))
    columns = np.zeros((RANDOM_COLUMNS, 8))
    columns[:, X : Z + 1] = center + share * (target - center)
    columns[:, Z] -= HEIGHT_UNITS * views.unit / 2
    columns[:, HEIGHT] = HEIGHT_UNITS * views.unit
    columns[:, RADIUS] = RADIUS_UNITS * views.unit
    columns[:, OPENING] = USUAL_OPENING
    return Columns(columns)


def expected_llr(views: Views, amplitude_px: float, response: Response | None = None) -> FloatMap:
    """(V, H, W) evidence a displacement would give where anything was measured at all."""
    return expected_evidence(views.llr, views.sigma_px, amplitude_px, response)


def expected_evidence(
    llr: FloatMap, sigma_px: FloatMap, amplitude_px: float, response: Response | None = None
) -> FloatMap:
    """Likewise for (V, H, W) evidence and sigma."""
    measured = np.isfinite(sigma_px) & (llr != 0)
    sigma = np.where(measured, sigma_px, 1.0).astype(np.float32)
    size = np.full_like(sigma, amplitude_px)
    if response is None:
        expected = np.clip(log_likelihood_ratio(size, sigma), LLR_MIN, LLR_MAX)
    else:
        expected = response(size, sigma)
    return np.where(measured, expected, 0).astype(np.float32)
