"""The command line: every command."""

import signal
from collections.abc import Callable
from functools import wraps
from typing import Annotated

import typer

from locate import __version__
from locate.commands.adapt import adapt
from locate.commands.bos import bos
from locate.commands.calibrate import calibrate
from locate.commands.clean import clean
from locate.commands.console import out
from locate.commands.detect import detect
from locate.commands.doctor import doctor
from locate.commands.evaluate import evaluate
from locate.commands.given_values import Given, with_checked_values
from locate.commands.pattern import pattern
from locate.commands.plan import plan
from locate.commands.robot import robot
from locate.commands.run import AGAIN, demo, run
from locate.commands.simulate import simulate
from locate.commands.survey import survey
from locate.commands.train import train
from locate.commands.view import view
from locate.journal.progress import interruptible

app = typer.Typer(
    help="3D maps of plumes and leaks from a video by a moving camera.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
)


def _ending_in_one_line(command: Callable[Given, None]) -> Callable[Given, None]:
    """The command, which Ctrl-C and SIGTERM end with one line."""

    @wraps(command)
    def run_interruptibly(*args: Given.args, **kwargs: Given.kwargs) -> None:
        with interruptible():
            command(*args, **kwargs)

    return run_interruptibly


COMMANDS = (
    *(run, demo, view, clean, survey, detect, adapt, simulate, evaluate, bos, pattern, train),
    *(calibrate, plan, doctor),
)
for command in COMMANDS:
    app.command(epilog=AGAIN if command is run else None)(
        _ending_in_one_line(with_checked_values(command))
    )


@robot.callback()
def _let_robot_answer_signals() -> None:
    """Find plumes live, on a robot."""
    if signal.getsignal(signal.SIGINT) is not signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.default_int_handler)
    signal.signal(signal.SIGTERM, signal.SIG_DFL)


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
