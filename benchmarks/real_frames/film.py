"""Runs each recording as it is, then renders the plumes onto it; keeps what the folder holds.

    python -m benchmarks.real_frames film [RECORDING...] --work work/real_frames

Prints what each run found, and the CPU seconds of each rendering.
"""

import argparse
import time

from benchmarks.real_frames.cases import (
    Case,
    add_case_arguments,
    cases_of,
    is_filmed,
    plain_case,
    usable,
)
from benchmarks.real_frames.places import NoPosesError, posed_photos, put_plume
from benchmarks.real_frames.run import OWN, score_case
from locate.simulation import render_strengths_onto_set


def add_arguments(parser: argparse.ArgumentParser) -> None:
    add_case_arguments(parser)


def main(options: argparse.Namespace) -> None:
    for recording in usable(options):
        if is_filmed(recording):
            continue
        plain = plain_case(recording, options.work)
        print(score_case(plain, OWN), flush=True)
        try:
            photos = posed_photos(plain.folder / f"run_{OWN}")
        except NoPosesError as error:
            print(f"{recording.name} | skipped: {error}", flush=True)
            continue
        by_place: dict[int, list[Case]] = {}
        for case in cases_of(recording, options):
            if case.place is not None and not case.filmed:
                by_place.setdefault(case.place, []).append(case)
        for place, cases in by_place.items():
            started = time.process_time()
            scaled, scene = put_plume(photos, place)
            outputs = {case.strength_px: case.folder for case in cases}
            render_strengths_onto_set(scene, scaled, outputs, reduce=1)
            cpu_s = time.process_time() - started
            names = ", ".join(folder.name for folder in outputs.values())
            print(f"{recording.name} | {names} | {cpu_s:.0f} CPU s", flush=True)
