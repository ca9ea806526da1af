"""`locate plan`."""

import re
from pathlib import Path
from typing import Annotated, Literal

import typer

from geometry.errors import BadInputError
from locate.commands.console import out

Gas = Literal["air", "methane", "propane", "hydrogen", "helium", "co2", "sf6"]
SOURCE = "Source: locate plan --gas methane --leak 5 --to-plume 8 --to-background 15 --fov 65"
CAMERA = "Camera: locate plan --rise 150 --radius .1 --to-plume 8 --to-background 15 --focal 1450"
STEP_SHARES = (0.0, 0.05, 0.1, 0.25, 0.5, 1.0)
"""Heights of the table, of what the frame holds."""


def plan(
    to_plume: Annotated[
        float,
        typer.Option(min=1e-2, max=1e6, help="Range to the plume, m.", rich_help_panel=CAMERA),
    ],
    to_background: Annotated[
        float,
        typer.Option(
            min=1e-2, max=1e6, help="Range to what is behind it, m.", rich_help_panel=CAMERA
        ),
    ],
    gas: Annotated[Gas, typer.Option(help="What comes out.", rich_help_panel=SOURCE)] = "air",
    rise: Annotated[
        float,
        typer.Option(
            min=-200, max=5000, help="Kelvin over the air around it.", rich_help_panel=SOURCE
        ),
    ] = 0.0,
    mole_fraction: Annotated[
        float,
        typer.Option(
            min=1e-6, max=1, help="Share of the gas; the rest is air.", rich_help_panel=SOURCE
        ),
    ] = 1.0,
    leak: Annotated[
        float | None,
        typer.Option(
            min=1e-6, max=1e9, help="Leak rate in g/s; or --radius.", rich_help_panel=SOURCE
        ),
    ] = None,
    radius: Annotated[
        float | None,
        typer.Option(
            min=1e-4, max=1e3, help="Radius of the source in m; or --leak.", rich_help_panel=SOURCE
        ),
    ] = None,
    focal: Annotated[
        float | None,
        typer.Option(min=1, max=1e7, help="Focal length in px; or --fov.", rich_help_panel=CAMERA),
    ] = None,
    fov: Annotated[
        float | None,
        typer.Option(
            min=0.1, max=150, help="Horizontal angle of view, degrees.", rich_help_panel=CAMERA
        ),
    ] = None,
    size: Annotated[
        str, typer.Option(help="Of the frames, px.", rich_help_panel=CAMERA)
    ] = "1920x1080",
    max_side: Annotated[
        int,
        typer.Option(
            min=64,
            help="Longest side that px are counted in; the evidence of pixels is of 1280.",
            rich_help_panel=CAMERA,
        ),
    ] = 1280,
    coding: Annotated[
        Literal["lossless", "video"],
        typer.Option(help="H.264, HEVC and the like are video.", rich_help_panel=CAMERA),
    ] = "video",
    arc: Annotated[
        float,
        typer.Option(
            min=1, max=360, help="Degrees that the camera goes round.", rich_help_panel=CAMERA
        ),
    ] = 45.0,
    output: Annotated[
        Path, typer.Option("-o", "--output", help="The picture to write, .png.")
    ] = Path("plan.png"),
) -> None:
    """Tell what a camera could see of a plume: displacement in px, frames and arc."""
    from geometry.refraction import AMBIENT_TEMPERATURE_K
    from geometry.rising_plume import RisingPlume
    from locate.planning.picture import draw_plan
    from locate.planning.plan import Plan, PlannedSource, PlannedView
    from locate.planning.table import level_table, plan_table

    temperature_k = AMBIENT_TEMPERATURE_K + rise
    if (leak is None) == (radius is None):
        raise BadInputError("give either --leak (g/s) or --radius (m) of the source")
    if gas == "air" and rise == 0:
        raise BadInputError("air as warm as the air around it is not seen; give --rise or --gas")
    if radius is not None:
        plume = RisingPlume.of_source(radius)
    else:
        plume = RisingPlume.of_leak(
            (leak or 0) / 1000, gas=gas, mole_fraction=mole_fraction, temperature_k=temperature_k
        )
    planned = Plan(
        source=PlannedSource(
            gas=gas, mole_fraction=mole_fraction, temperature_k=temperature_k, plume=plume
        ),
        view=PlannedView.of_camera(
            _parse_size(size),
            focal_px=focal,
            fov_deg=fov,
            max_side=max_side,
            range_to_plume_m=to_plume,
            range_to_background_m=to_background,
        ),
        coding=coding,
        arc_deg=arc,
    )
    out.print(plan_table(planned))
    heights_m = [share * planned.view.shown_m for share in STEP_SHARES]
    out.print(level_table(planned.levels(heights_m)))
    out.print(f"Picture: {draw_plan(planned, output)}", soft_wrap=True)


def _parse_size(text: str) -> tuple[int, int]:
    found = re.fullmatch(r"(\d{2,5})x(\d{2,5})", text)
    if found is None:
        raise BadInputError(f"--size {text}: write width x height in px, such as 1920x1080")
    return int(found[1]), int(found[2])
