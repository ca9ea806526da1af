"""`locate train`."""

from pathlib import Path
from typing import Annotated

import typer

from locate.commands.console import Output, err, out
from locate.journal import interruptible, progress_bars


def train(
    config: Annotated[Path, typer.Argument(help="A training config, see detect/dybs/training.")],
    output: Output,
    data: Annotated[
        Path | None,
        typer.Option(help="Where its folders of samples are; beside the config if left out."),
    ] = None,
    processes: Annotated[int, typer.Option(help="For rendering samples that are missing.")] = 1,
) -> None:
    """Train a network; the same command goes on where a killed one stood."""
    from detect.learning.config import TrainConfig

    loaded = TrainConfig.load(config, data)
    try:
        from detect.learning.export import publish
        from detect.learning.plot import plot_training
        from detect.learning.render import render_missing
        from detect.learning.trainer import train as run
    except ModuleNotFoundError as error:
        from geometry.errors import BadInputError

        raise BadInputError("torch is missing; pip install 'plume-locate[train]'") from error

    with interruptible(), progress_bars(err) as report:
        render_missing(loaded, data or config.parent, report=report, processes=processes)
        run(loaded, output, report=report)
    files = [*publish(loaded, output), plot_training(output, output / "training.png")]
    for file in files:
        out.print(f"Wrote {file}", soft_wrap=True)
