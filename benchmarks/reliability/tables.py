"""What recordings showed of stated probabilities, as tables."""

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from scipy.special import expit

from benchmarks.reliability.outcomes import ProbabilityBin, RecordingOutcome, Share, binned
from detect.calibration import fit_logistic
from detect.kinds import LEARNED_RELIABILITY
from geometry.arrays import BoolArray, FloatArray

RATIOS = (0.0, 0.5, 1.0, 2.0, np.inf)
ALARMS = (0.5, 0.1, 0.01, 0.001)


def report(every: Sequence[RecordingOutcome]) -> str:
    parts = (reported, unasked, clutter, limits, believable)
    return "\n\n".join(part(every) for part in parts)


def reported(every: Sequence[RecordingOutcome]) -> str:
    """Of what maps report: how much is true, and how much of what is there was found."""
    true = [each for one in every for each in one.truths]
    stated = [plume.probability for one in every for plume in one.plumes]
    there, empty = split_by_plume(every)
    alarms = [bool(one.plumes) for one in empty]
    lines = [
        f"recordings with a plume: {len(there)}, without: {len(empty)}",
        f"plumes reported that are true: {Share.of(true)}",
        f"recordings without a plume that report one: {Share.of(alarms)}",
        f"plumes found: {Share.of([one.found for one in there])}",
    ]
    if stated:
        lines.append(f"stated: {np.mean(stated):.6f} in the mean, {min(stated):.6f} at least")
    return "\n".join(lines)


def unasked(every: Sequence[RecordingOutcome]) -> str:
    """Of the strongest of each recording, nothing asked of it: stated against true."""
    loud = [one for one in every if one.strongest.nats >= one.floor_nats]
    lines = [
        "| stated | strongest column: mean stated | true | true of those above the floor "
        "| strongest plume without level or floor: mean stated | true |",
        "|---|---|---|---|---|---|",
    ]
    rows = zip(by_column(every), by_column(loud), by_plume(every), strict=True)
    for column, above, plume in rows:
        lines.append(
            f"| {column.low:g} to {column.high:g} | {column.stated:.4f} | {column.true} "
            f"| {above.true} | {plume.stated:.4f} | {plume.true} |"
        )
    return "\n".join(lines)


def by_column(every: Sequence[RecordingOutcome]) -> list[ProbabilityBin]:
    stated = [one.strongest.probability for one in every]
    return binned(stated, [one.true(one.strongest) for one in every])


def by_plume(every: Sequence[RecordingOutcome]) -> list[ProbabilityBin]:
    stated = [one.unasked.probability for one in every]
    return binned(stated, [one.true(one.unasked) for one in every])


def clutter(every: Sequence[RecordingOutcome]) -> str:
    """What is strongest where there is no plume: nats a view, and how rare it is said to be."""
    _, empty = split_by_plume(every)
    loud = [one.strongest.nats >= one.floor_nats for one in empty]
    lines = [
        f"strongest column without a plume, nats a view: {spread(empty)}",
        f"at or above the floor: {Share.of(loud)}",
        f"near where the plume would have stood: {Share.of([one.strongest.near for one in empty])}",
        "| false alarm stated below | strongest column without a plume | strongest plume |",
        "|---|---|---|",
    ]
    columns = np.array([1 - one.strongest.probability for one in empty])
    plumes = np.array([1 - one.unasked.probability for one in empty])
    lines += [f"| {a} | {Share.of(columns < a)} | {Share.of(plumes < a)} |" for a in ALARMS]
    return "\n".join(lines)


def limits(every: Sequence[RecordingOutcome]) -> str:
    """Plumes found, by their strength over the stated limit, and what a plume does to that."""
    there, empty = split_by_plume(every)
    lines = ["| strength over the stated limit | found |", "|---|---|"]
    lines += [f"| {low:g} to {high:g} | {share} |" for low, high, share in found_over_limit(every)]
    blind = [one.found for one in there if one.limit_px is None]
    lines.append(f"| no limit stated | {Share.of(blind)} |")
    for name, some in (("with", there), ("without", empty)):
        if some:
            limit_px = np.median([np.inf if o.limit_px is None else o.limit_px for o in some])
            level = np.median([one.threshold_nats for one in some])
            lines.append(f"median {name} a plume: limit {limit_px:.3f} px, level {level:.0f} nats")
    return "\n".join(lines)


def believable(every: Sequence[RecordingOutcome]) -> str:
    """How often the strongest plumes are true by their evidence a view, and how the cap does."""
    told = [one for one in every if one.unasked.nats > 0]
    nats = np.array([one.unasked.nats / one.views for one in told])
    true = np.array([one.true(one.unasked) for one in told])
    if true.all() or not true.any():
        return "all of the strongest plumes are true, or none is"
    slope, level = fit_logistic(nats[:, None], true)
    rightly = expit(LEARNED_RELIABILITY.offset + LEARNED_RELIABILITY.slope_per_nat * nats)
    loss, chance = (log_loss(p, true) for p in (rightly, np.full(len(true), true.mean())))
    return (
        f"logit of being true, strongest plumes: {level:.3f} + {slope:.3f} a nat a view\n"
        f"log loss of what maps believe: {loss:.3f}; of the mere share: {chance:.3f}"
    )


def log_loss(probability: FloatArray, labels: BoolArray) -> float:
    """Mean negative log likelihood of labels, nats."""
    right = np.where(labels, probability, 1 - probability)
    return float(-np.log(np.maximum(right, 1e-12)).mean())


def found_over_limit(every: Sequence[RecordingOutcome]) -> list[tuple[float, float, Share]]:
    there, _ = split_by_plume(every)
    return [
        (low, high, Share.of([one.found for one in there if low <= one.over_limit < high]))
        for low, high in pairwise(RATIOS)
    ]


def split_by_plume(
    every: Sequence[RecordingOutcome],
) -> tuple[list[RecordingOutcome], list[RecordingOutcome]]:
    """Those with a plume, and those without."""
    return [one for one in every if one.amplitude_px], [
        one for one in every if not one.amplitude_px
    ]


def spread(every: Sequence[RecordingOutcome]) -> str:
    nats = [one.strongest.nats / one.views for one in every]
    if not nats:
        return "none"
    median, high = np.quantile(nats, [0.5, 0.9])
    return f"median {median:.2f}, 90 % below {high:.2f}, largest {max(nats):.2f}"
