"""`locate view`."""

import os
import subprocess
import sys
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Annotated

import typer

from geometry.errors import BadInputError
from locate.commands.console import err, out

VIEWER = (sys.executable, "-m", "rerun", "--bind", "127.0.0.1")
"""Rerun alone would listen to the network."""
FORCED_REPORTS = "FORCE_RERUN_ANALYTICS"
"""What makes Rerun report its use to its makers whatever else is set."""


def view(
    output: Annotated[Path, typer.Argument(help="A run folder.")],
    save: Annotated[
        Path | None, typer.Option(help="Write the recording to a file, .rrd, and open nothing.")
    ] = None,
) -> None:
    """Look through a finished run in space and time, with the viewer Rerun."""
    from locate.pipeline.view import write_view

    if save is not None:
        write_view(output, save)
        out.print(f"{save}: open it with `rerun {save}`", soft_wrap=True)
        return
    with TemporaryDirectory(prefix="locate-view-") as folder:
        path = Path(folder) / "run.rrd"
        write_view(output, path)
        err.print("The viewer is open; close it to end.")
        started = subprocess.run([*VIEWER, str(path)], env=viewer_environment(), check=False)
        if started.returncode:
            raise BadInputError(
                "the viewer Rerun did not start; --save FILE.rrd writes a file to open elsewhere"
            )


def viewer_environment() -> dict[str, str]:
    """What the viewer is started in: as on a build server, where Rerun reports nothing."""
    kept = {name: value for name, value in os.environ.items() if name != FORCED_REPORTS}
    return {**kept, "CI": "true"}
