"""`locate survey`."""

from pathlib import Path
from typing import Annotated

import typer

from geometry.named_paths import resolve_path
from geometry.reports import ignore_report
from locate.commands.console import Verbose, Weights, err, out
from locate.journal.log import log_to_file
from locate.journal.progress import progress_bars
from locate.pipeline.config import DetectorName


def survey(
    output: Annotated[
        str, typer.Option("-o", "--output", help="The folder to write; may be s3:// and the like.")
    ],
    flights: Annotated[
        list[str] | None,
        typer.Argument(
            help="Videos, folders of photos, or finished run folders; may be s3:// and the like."
        ),
    ] = None,
    detector: Annotated[
        DetectorName | None, typer.Option(help="As of locate run, for every flight.")
    ] = None,
    weights: Weights = None,
    camera: Annotated[
        Path | None, typer.Option(help="As of locate run; one camera for every flight.")
    ] = None,
    focal: Annotated[
        float | None, typer.Option(min=1e-6, max=1e7, help="Focal length in px of the frames.")
    ] = None,
    max_frames: Annotated[
        int | None, typer.Option(min=2, help="The most frames to use of each flight.")
    ] = None,
    cell: Annotated[
        float | None, typer.Option(min=1e-2, help="Edge of a cell of the ground in m.")
    ] = None,
    displacement: Annotated[
        float | None,
        typer.Option(
            min=1e-3,
            help="A flight covered a cell where it would have detected a column of this mean "
            "displacement in px; the median sighting's if left out.",
        ),
    ] = None,
    radius: Annotated[
        float | None, typer.Option(min=1e-3, help="Radius of that column in m; likewise.")
    ] = None,
    height: Annotated[
        float | None, typer.Option(min=1e-3, help="Height of that column in m; likewise.")
    ] = None,
    wander: Annotated[
        float | None,
        typer.Option(min=0, help="How far (m, 1 sigma) columns are from their hotspot."),
    ] = None,
    scheduler: Annotated[
        str, typer.Option(help="Address of a Dask scheduler, or all cores of this machine.")
    ] = "local",
    verbose: Verbose = False,
) -> None:
    """Join many flights to one updraft map; add flights to an existing one."""
    from locate.survey.build import SURVEY, build_survey, open_survey
    from locate.survey.storage import fetch_flights, mirror_folder
    from locate.survey.table import survey_table

    asked = {
        "detector": detector,
        "weights": None if weights is None else resolve_path(weights),
        "camera": None if camera is None else resolve_path(camera),
        "focal_px": focal,
        "max_frames": max_frames,
        "cell_m": cell,
        "displacement_px": displacement,
        "radius_m": radius,
        "height_m": height,
        "wander_m": wander,
    }
    given = {name: value for name, value in asked.items() if value is not None}
    with (
        mirror_folder(output, scheduler) as folder,
        progress_bars(err) as report,
    ):
        before = open_survey(folder).settings
        with log_to_file(folder / "log.jsonl", console=err if verbose else None):
            done = build_survey(
                fetch_flights(flights or [], folder, scheduler),
                folder,
                settings=before.model_copy(update=given),
                scheduler=scheduler,
                report=ignore_report if verbose else report,
            )
    out.print(survey_table(done))
    for note in done.notes:
        out.print(f"- {note}")
    out.print(f"\nMap:    {output}/map.html", soft_wrap=True)
    out.print(f"Survey: {output}/{SURVEY}", soft_wrap=True)
