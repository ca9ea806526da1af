"""The shares that are true by what was stated.

    python -m benchmarks.reliability report --work work/stated [--plot reliability.png]

Prints the tables; `--plot` draws a picture of them.
"""

import argparse
from pathlib import Path

from benchmarks.reliability.outcomes import RecordingOutcome
from benchmarks.reliability.picture import picture
from benchmarks.reliability.recordings import add_recording_arguments, chosen
from benchmarks.reliability.tables import report
from geometry.errors import BadInputError
from geometry.image_files import write_image


def add_arguments(parser: argparse.ArgumentParser) -> None:
    add_recording_arguments(parser)
    parser.add_argument("--plot", type=Path)


def main(options: argparse.Namespace) -> None:
    paths = [options.work / f"{seed}.json" for seed in chosen(options)]
    every = [RecordingOutcome.load(path) for path in paths if path.exists()]
    if not every:
        raise BadInputError(f"{options.work}: no scores there yet; run film and score first")
    print(report(every))
    if options.plot:
        write_image(options.plot, picture(every))
