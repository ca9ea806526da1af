"""What recordings showed of stated probabilities and limits, as tables."""

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from benchmarks.reliability.outcomes import (
    Candidate,
    ProbabilityBin,
    RecordingOutcome,
    Share,
    binned,
    calibration_error,
)
from benchmarks.reliability.recordings import CONDITIONS
from detect.calibration import fit_logistic

RATIOS = (0.0, 0.5, 1.0, 1.5, 3.0, np.inf)


def report(every: Sequence[RecordingOutcome]) -> str:
    """All tables: of the recordings held out, and the fit to the others."""
    judged = [one for one in every if one.held_out]
    rest = [one for one in every if not one.held_out]
    parts = [f"held out: {len(judged)}, others: {len(rest)}"]
    for name, some in (("held out", judged), ("others", rest)):
        if some:
            parts += [f"## {name}", reported(some), calibration(some), limits(some)]
    return "\n\n".join([*parts, "## fit to the others", fitted(rest)])


def reported(every: Sequence[RecordingOutcome]) -> str:
    """What maps report, by condition."""
    lines = [
        "| | plumes found | reported without one | reported plumes that are true "
        "| median error, % of range | NEES, median and mean (2.4 and 3 expected) |",
        "|---|---|---|---|---|---|",
    ]
    for condition in (*CONDITIONS, "all"):
        some = [one for one in every if condition in (one.condition, "all")]
        there, empty = split_by_plume(some)
        found = [one.found for one in there if one.found]
        cells = (
            Share.of([one.found is not None for one in there]),
            Share.of([bool(one.plumes) for one in empty]),
            Share.of([right for one in some for right in one.truths]),
            f"{100 * np.median([each.error for each in found]):.1f}" if found else "",
            _spread([each.nees for each in found]) if found else "",
        )
        lines.append(f"| {condition} | " + " | ".join(map(str, cells)) + " |")
    return "\n".join(lines)


def _spread(values: Sequence[float]) -> str:
    return f"{np.median(values):.1f}, {np.mean(values):.1f}"


def calibration(every: Sequence[RecordingOutcome]) -> str:
    """Of the surest column of each recording: stated against true."""
    bins = by_probability(every)
    lines = ["| stated | mean | true |", "|---|---|---|"]
    lines += [f"| {b.low:g} to {b.high:g} | {b.stated:.3f} | {b.true} |" for b in bins]
    return "\n".join([*lines, f"calibration error: {calibration_error(bins):.3f}"])


def by_probability(every: Sequence[RecordingOutcome]) -> list[ProbabilityBin]:
    surest = [(one.surest, one) for one in every]
    known = [(column, one) for column, one in surest if column is not None]
    return binned([column.probability for column, _ in known], [one.is_true(c) for c, one in known])


def limits(every: Sequence[RecordingOutcome]) -> str:
    """Plumes found, by their mean displacement over the stated limit."""
    lines = ["| displacement over the stated limit | " + " | ".join((*CONDITIONS, "all")) + " |"]
    lines.append("|---" * (len(CONDITIONS) + 2) + "|")
    by_condition = [
        found_over_limit([one for one in every if condition in (one.condition, "all")])
        for condition in (*CONDITIONS, "all")
    ]
    for rows in zip(*by_condition, strict=True):
        low, high, _ = rows[0]
        lines.append(f"| {low:g} to {high:g} | " + " | ".join(str(s) for *_, s in rows) + " |")
    blind = [one.found is not None for one in every if one.amplitude_px and one.limit_px is None]
    return "\n".join([*lines, f"found where no limit is stated: {Share.of(blind)}"])


def found_over_limit(every: Sequence[RecordingOutcome]) -> list[tuple[float, float, Share]]:
    there, _ = split_by_plume(every)
    return [
        (low, high, Share.of([o.found is not None for o in there if low <= o.over_limit < high]))
        for low, high in pairwise(RATIOS)
    ]


def fitted(every: Sequence[RecordingOutcome]) -> str:
    """The logistic curve over the surest true and the surest false column of each recording.

    Columns that bend light inwards are left out: no plume of these recordings does.
    """
    scores, labels = [], []
    for one in every:
        for right in (True, False):
            column = surest([c for c in one.candidates if one.is_true(c) == right and c.sigmas > 0])
            if column is not None:
                scores.append([column.sigmas, np.log1p(max(column.nats_per_view, 0))])
                labels.append(right)
    if len(set(labels)) < 2:
        return "too few recordings"
    per_sigma, per_log_nat, offset = fit_logistic(np.array(scores), np.array(labels))
    return (
        f"{len(labels)} columns, {sum(labels)} true: logit {offset:.2f} + {per_sigma:.3f} a sigma "
        f"+ {per_log_nat:.3f} a log(1 + nat a view)"
    )


def surest(columns: Sequence[Candidate]) -> Candidate | None:
    return max(columns, key=lambda each: each.probability, default=None)


def split_by_plume(
    every: Sequence[RecordingOutcome],
) -> tuple[list[RecordingOutcome], list[RecordingOutcome]]:
    """Those with a plume, and those without."""
    return [one for one in every if one.amplitude_px], [
        one for one in every if not one.amplitude_px
    ]
