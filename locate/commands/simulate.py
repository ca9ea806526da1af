"""`locate simulate`."""

from pathlib import Path
from typing import Annotated

import typer

from locate.commands.console import Output, err, out
from locate.journal import progress_bars


def simulate(
    scene: Annotated[Path, typer.Argument(help="A scene file, see examples/scenes.")],
    output: Output,
    onto: Annotated[
        Path | None,
        typer.Option(help="Render the plume onto this posed photo set instead of a made scene."),
    ] = None,
) -> None:
    """Render a video of a scene with plumes, with its ground truth."""
    from locate.simulation import Scene, render_onto
    from locate.simulation import simulate as render

    loaded = Scene.load(scene)
    with progress_bars(err) as report:

        def progress(done: int, total: int) -> None:
            report("rendering", done / total)

        if onto is None:
            render(loaded, output, progress=progress)
        else:
            render_onto(loaded, onto, output, progress=progress)
    out.print(f"Truth: {output / 'truth.json'}", soft_wrap=True)
