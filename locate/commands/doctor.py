"""`locate doctor`."""

from collections.abc import Iterable
from math import radians, tan
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.table import Table

from locate.commands.console import out

if TYPE_CHECKING:
    from locate.recording import Recording

LIBRARIES = (
    *("numpy", "scipy", "opencv-contrib-python-headless", "pycolmap", "gtsam", "onnxruntime"),
    *("av", "pydantic"),
)
USUAL_FOV_DEG = 65.0
CODED_FINELY = 2.0
"""Bits a pixel from which a codec was not seen to hide plumes (docs/seeing.md)."""


def doctor(
    file: Annotated[
        Path | None,
        typer.Argument(help="A video, a folder of photos or a bag.", show_default=False),
    ] = None,
) -> None:
    """Say what is installed; of a recording: what it is, how long a run takes, what it could show.

    Nothing is written.
    """
    from locate.planning.installed import describe_machine, list_extras, version_of

    out.print(describe_machine())
    out.print(", ".join(f"{name} {version_of(name) or 'missing'}" for name in LIBRARIES))
    extras = list_extras()
    for extra in extras:
        missing = f"pip install 'plume-locate[{extra.name}]' (lacks {', '.join(extra.missing)})"
        out.print(f"  {extra.name:8} {missing if extra.missing else 'installed'}", soft_wrap=True)
    if not extras:
        out.print("  extras are not known: this program is not installed, it runs from its source")
    if file is not None:
        _examine(file)


def _examine(file: Path) -> None:
    from locate.pipeline.config import RunConfig
    from locate.pipeline.source import RecordingSource
    from locate.planning.duration import duration_text, estimate_run_time
    from locate.planning.file_facts import odd_things, recording_facts

    usual = RunConfig(recording=file)
    recording = RecordingSource.of(usual).open_frames()
    out.print()
    out.print(_two_columns(str(file), recording_facts(recording)))
    took = estimate_run_time(recording, usual.amounts)
    for odd in odd_things(recording):
        out.print(f"- {odd}", soft_wrap=True)
    out.print(
        f"\nA run takes about {duration_text(took.total_s)} of processor time: frames "
        f"{took.frames_s:.0f} s, poses {took.poses_s:.0f} s, detections {took.detections_s:.0f} s, "
        f"the rest {took.rest_s:.0f} s. Reading was timed on the first frames, the rest is that of "
        "the bundled sample by frames, pixels and the speed of this machine; half or twice as "
        "much is possible.\n"
    )
    out.print(_prospect_table(recording))


def _two_columns(title: str, rows: Iterable[tuple[str, str]]) -> Table:
    table = Table(title=title, title_justify="left", show_header=False)
    table.add_column()
    table.add_column(overflow="fold")
    for row in rows:
        table.add_row(*row)
    return table


def _prospect_table(recording: "Recording") -> Table:
    from locate.planning.plan import NEEDED_PX, Coding
    from locate.planning.prospect import RANGES_M, strengths_px

    focal_px = recording.focal_prior_px
    known = "" if focal_px else f", taking an angle of view of {USUAL_FOV_DEG:.0f} degrees"
    focal_px = focal_px or recording.width / (2 * tan(radians(USUAL_FOV_DEG) / 2))
    bits = recording.bits_per_pixel
    coding: Coding = "video" if bits is not None and bits < CODED_FINELY else "lossless"
    table = Table(
        title=f"Strength of plumes by range to plume and background, px; {NEEDED_PX[coding]:g} px "
        f"are wanted{known}; locate plan tells more",
        title_justify="left",
    )
    table.add_column("plume")
    for near_m, far_m in RANGES_M:
        table.add_column(f"{near_m:g}, {far_m:g} m", justify="right")
    size = recording.width, recording.height
    for name, values in strengths_px(size, focal_px, coding).items():
        table.add_row(name, *(f"{value:.3f}" for value in values))
    return table
