"""The command line: every command, and how a failure ends."""

import errno
import sys
from typing import Annotated

import typer

from geometry.errors import LocateError
from locate import __version__
from locate.commands.adapt import adapt
from locate.commands.bos import bos
from locate.commands.console import err, out
from locate.commands.detect import detect
from locate.commands.evaluate import evaluate
from locate.commands.pattern import pattern
from locate.commands.robot import robot
from locate.commands.run import demo, run
from locate.commands.simulate import simulate
from locate.commands.survey import survey
from locate.commands.train import train

NO_SPACE = (errno.ENOSPC, errno.EDQUOT)

app = typer.Typer(
    help="3D maps of plumes and leaks from a video by a moving camera.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
)
for command in (run, demo, survey, detect, adapt, simulate, evaluate, bos, pattern, train):
    app.command()(command)
app.add_typer(robot)


def _version(asked: bool) -> None:
    if asked:
        out.print(f"locate {__version__}")
        raise typer.Exit


@app.callback()
def _root(
    _: Annotated[
        bool,
        typer.Option("--version", callback=_version, is_eager=True, help="Print the version."),
    ] = False,
) -> None:
    pass


def main() -> None:
    """Runs the command; every expected failure becomes one line and an exit code."""
    try:
        app()
    except LocateError as error:
        _fail(str(error), error.exit_code)
    except OSError as error:
        if error.errno not in NO_SPACE:
            raise
        _fail(f"{error.filename or 'disk'}: no space left; free some and run again", 2)


def _fail(message: str, code: int) -> None:
    err.print(f"locate: {message}", style="bold red", soft_wrap=True, markup=False, highlight=False)
    sys.exit(code)
