"""The command line of a benchmark: `python -m benchmarks.NAME SUB-COMMAND ...`."""

import argparse
import sys
from importlib import import_module

import cv2

from geometry.errors import LocateError

AS_WRITTEN = argparse.RawDescriptionHelpFormatter


def run(package: str, *names: str) -> None:
    """Runs the sub-command that the command line names; OpenCV gets one thread.

    Args:
        package: Whose docstring describes the benchmark.
        names: The sub-commands. `next-view` is the module `next_view` of the package, with
            `add_arguments(parser)` and `main(options)`; only the one asked for is imported.
    """
    parser = argparse.ArgumentParser(
        prog=f"python -m {package}",
        description=import_module(package).__doc__,
        formatter_class=AS_WRITTEN,
    )
    tasks = parser.add_subparsers(required=True, metavar="SUB-COMMAND")
    for name in [name for name in names if name in sys.argv[1:2]] or names:
        module = import_module(f"{package}.{name.replace('-', '_')}")
        about = module.__doc__ or ""
        task = tasks.add_parser(
            name, help=about.splitlines()[0], description=about, formatter_class=AS_WRITTEN
        )
        module.add_arguments(task)
        task.set_defaults(main=module.main)
    options = parser.parse_args()
    cv2.setNumThreads(1)
    try:
        options.main(options)
    except LocateError as error:
        parser.error(str(error))
