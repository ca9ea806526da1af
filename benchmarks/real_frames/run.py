"""Runs `locate run` on every case that was filmed, and scores it; done cases are skipped.

    python -m benchmarks.real_frames run [RECORDING...] --work work/real_frames [--poses film]

Prints a line for each case: what was found, and how well.
"""

import argparse
import time
from pathlib import Path

from benchmarks.real_frames.cases import Case, add_case_arguments, cases_of, usable
from benchmarks.real_frames.score import CaseScore, score_map
from geometry.errors import LocateError
from locate.pipeline.config import RunConfig
from locate.pipeline.run import Run

OWN, FILMED = "own", "film"


def score_path(case: Case, poses: str) -> Path:
    return case.folder / f"score_{poses}.json"


def score_case(case: Case, poses: str) -> str:
    """Runs a case, unless it is done; a line that says what came out."""
    path = score_path(case, poses)
    if not path.exists():
        given = case.film / "truth.json" if poses == FILMED else None
        config = RunConfig(recording=case.frames, poses=given)
        run_case(case, config, poses).save(path)
    return CaseScore.load(path).line()


def run_case(case: Case, config: RunConfig, poses: str) -> CaseScore:
    """The score of a whole run, from the start."""
    folder = case.folder / f"run_{poses}"
    started = time.process_time()
    try:
        plume_map = Run(config, folder, force=True).run()
        return score_map(case, folder, plume_map, poses, time.process_time() - started)
    except LocateError as error:
        return CaseScore(
            recording=case.recording.name,
            strength_px=case.strength_px,
            place=case.place,
            poses=poses,
            cpu_s=time.process_time() - started,
            failure=" ".join(str(error).split()),
            found=None if case.place is None else False,
        )


def add_arguments(parser: argparse.ArgumentParser) -> None:
    add_case_arguments(parser)
    parser.add_argument(
        "--poses",
        choices=(OWN, FILMED),
        default=OWN,
        help=f"{FILMED}: those the plume was rendered with, which saves a reconstruction each; "
        "the run then has no sparse points. The table says so.",
    )


def main(options: argparse.Namespace) -> None:
    for recording in usable(options):
        for case in cases_of(recording, options):
            poses = OWN if case.place is None else options.poses
            if case.filmed:
                print(score_case(case, poses), flush=True)
            else:
                print(f"{recording.name} | {case.folder.name} | skipped: not filmed", flush=True)
