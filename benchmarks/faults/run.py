"""Disturbs runs in every way, gives the command again, and compares with an undisturbed run.

    python -m benchmarks.faults run [--kills 60] [--seed 0] [--step 1] [--tries 6]
                                   [--only WORDS]

Prints a table: how often it was tried, in how many cases the folder ended the same; and what was
lost in the others, as it happens. A run that is disturbed must end by the kill itself or by one
line with exit code 2. Full disks are mounted in a name space of Linux (`unshare`).
"""

import argparse
import sys
import tempfile
from functools import partial
from pathlib import Path

from benchmarks.faults.kinds import (
    AT_RANDOM,
    KINDS,
    damage_files,
    fail_at_changes,
    kill_at_changes,
    kill_at_random,
)
from benchmarks.faults.trial import Whole


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--kills", type=int, default=60, help="kills at random moments")
    parser.add_argument("--seed", type=int, default=0, help="of the random moments")
    parser.add_argument("--step", type=int, default=1, help="every how many changes and files")
    parser.add_argument(
        "--tries", type=int, default=6, help="full disks of each kind, pairs of runs"
    )
    parser.add_argument("--only", default="", help="kinds whose name holds these words")


def main(options: argparse.Namespace) -> None:
    amounts = dict.fromkeys((kill_at_changes, fail_at_changes, damage_files), options.step)
    kill = partial(kill_at_random, seed=options.seed)
    amounts[kill] = options.kills
    with tempfile.TemporaryDirectory() as work:
        whole = Whole.make(Path(work))
        print("| fault | tried | survived | lost |\n|---|---|---|---|", flush=True)
        for name, disturb in (KINDS | {AT_RANDOM: kill}).items():
            if options.only not in name:
                continue
            amount = amounts.get(disturb, options.tries)
            tried = lost = 0
            for loss in disturb(whole, Path(work) / "out", amount):
                tried += 1
                lost += bool(loss)
                if loss:
                    print(f"    {name}: {loss}", file=sys.stderr, flush=True)
            print(f"| {name} | {tried} | {tried - lost} | {lost} |", flush=True)
