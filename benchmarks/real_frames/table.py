"""What was found, by recording and strength, as a table and as scores.jsonl.

    python -m benchmarks.real_frames table [RECORDING...] --work work/real_frames

found, error, false  as `locate evaluate`: a source within 15 % of its range; median error in % of
                     range; plumes and directions that are none
stated limit         detection_limit_px, median; in brackets how many of the maps state one
mean inside          mean true displacement inside the plume, median frame; limits are stated so
silent frames        share of the measured frames without any evidence
sigma                median over frames of the median sigma of what was measured
informed / true      size of the true displacement by the normal equations that the detector keeps,
                     median over frames: 1 where nothing is lost
signal / noise       what the normal equations of one frame say for the true displacement, in
                     standard deviations of what they say for the same shape moved elsewhere in the
                     frame; median over frames
measured / true      slope of the measured against the true displacement of the pixels inside the
                     plume (above 0.3 of the frame's 95th percentile), median over frames
by texture, size,    the same in the lowest, middle and highest third of these pixels, by detail of
edge                 the frame, true displacement, and step of inverse depth
CPU s                of the runs
"""

import argparse
from collections.abc import Iterator, Sequence

from benchmarks.real_frames.cases import add_case_arguments, cases_of, usable
from benchmarks.real_frames.displacement import THIRDS
from benchmarks.real_frames.run import FILMED, OWN, score_path
from benchmarks.real_frames.score import CaseScore, median

COLUMNS = (
    "recording",
    "px",
    "poses",
    "found",
    "error, % of range",
    "false",
    "stated limit, px",
    "mean inside, px",
    "silent frames",
    "sigma, px",
    "informed / true",
    "signal / noise",
    "measured / true",
    *(f"by {name}" for name in THIRDS),
    "CPU s",
)
NONE = "-"


def scores_of(options: argparse.Namespace) -> Iterator[CaseScore]:
    """The cases asked for that are done."""
    for recording in usable(options):
        for case in cases_of(recording, options):
            paths = [score_path(case, poses) for poses in (OWN, FILMED)]
            yield from (CaseScore.load(path) for path in paths if path.exists())


def known(values: Sequence[float | None]) -> list[float]:
    return [value for value in values if value is not None]


def median_text(values: Sequence[float | None], form: str = ".2f") -> str:
    middle = median(known(values))
    return NONE if middle is None else format(middle, form)


def row(scores: Sequence[CaseScore]) -> str:
    """Of the cases of one recording, strength and source of poses; medians over the places."""
    first = scores[0]
    asked = [score for score in scores if score.found is not None]
    thirds = [score.thirds for score in scores if score.thirds is not None]
    limits = known([score.limit_px for score in scores])
    limit = median_text(limits) if limits else "none"
    cells = [
        first.recording,
        f"{first.strength_px:g}",
        first.poses,
        f"{sum(bool(score.found) for score in asked)} of {len(asked)}" if asked else NONE,
        median_text([score.error_percent for score in scores]),
        f"{sum(known([score.false_plumes for score in scores])):g}",
        limit if len(limits) in (0, len(scores)) else f"{limit} ({len(limits)} of {len(scores)})",
        median_text([score.mean_px for score in scores], ".3f"),
        median_text([score.silent_share for score in scores]),
        median_text([score.sigma_px for score in scores], ".3f"),
        median_text([score.informed for score in scores]),
        median_text([score.signal for score in scores], ".1f"),
        median_text([score.ratio for score in scores]),
        *(
            " ".join(median_text([of[name][k] for of in thirds]) for k in range(3))
            for name in THIRDS
        ),
        f"{sum(score.cpu_s for score in scores):.0f}",
    ]
    return f"| {' | '.join(cells)} |"


def table(scores: Sequence[CaseScore]) -> str:
    groups: dict[tuple[str, float, str], list[CaseScore]] = {}
    for score in scores:
        key = (score.recording, score.strength_px, score.poses)
        groups.setdefault(key, []).append(score)
    failures = [
        f"{score.recording}, {score.strength_px:g} px, place {score.place}: {score.failure}"
        for score in scores
        if score.failure
    ]
    head = [f"| {' | '.join(COLUMNS)} |", "|" + "---|" * len(COLUMNS)]
    return "\n".join([*head, *map(row, groups.values()), *failures])


def add_arguments(parser: argparse.ArgumentParser) -> None:
    add_case_arguments(parser)


def main(options: argparse.Namespace) -> None:
    scores = list(scores_of(options))
    options.work.mkdir(parents=True, exist_ok=True)
    lines = "".join(f"{score.line()}\n" for score in scores)
    (options.work / "scores.jsonl").write_text(lines)
    print(table(scores))
