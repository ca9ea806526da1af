"""`locate simulate`."""

from pathlib import Path
from typing import Annotated

import typer

from geometry.errors import BadInputError
from geometry.lock import hold_output
from locate.commands.console import Output, err, out
from locate.journal.progress import progress_bars


def simulate(
    scene: Annotated[Path, typer.Argument(help="A scene file, see examples/scenes.")],
    output: Output,
    onto: Annotated[
        Path | None,
        typer.Option(help="Render the plume onto this posed photo set instead of a made scene."),
    ] = None,
    reduce: Annotated[
        int | None,
        typer.Option(
            min=1,
            help="With --onto: photo pixels per pixel of the frames along a side. 1 keeps the full "
            "size; if left out, at least 2, so that resampling leaves no trace.",
        ),
    ] = None,
) -> None:
    """Render a video of a scene with plumes, or all flights of a campaign, with the truth."""
    from locate.simulation import Campaign, Scene, is_campaign, render_onto, simulate_campaign
    from locate.simulation import simulate as render

    campaign = Campaign.load(scene) if is_campaign(scene) else None
    if campaign is not None and onto is not None:
        raise BadInputError(f"{scene}: a campaign cannot be rendered --onto photos")
    if reduce is not None and onto is None:
        raise BadInputError("--reduce is for photos: give --onto as well")
    with hold_output(output), progress_bars(err) as report:

        def progress(done: int, total: int) -> None:
            report("rendering", done / total)

        if campaign is not None:
            simulate_campaign(campaign, output, progress=progress)
        elif onto is None:
            render(Scene.load(scene), output, progress=progress)
        else:
            render_onto(Scene.load(scene), onto, output, reduce=reduce, progress=progress)
    out.print(f"Truth: {output / 'truth.json'}", soft_wrap=True)
