"""`locate calibrate`."""

from pathlib import Path
from typing import Annotated

import typer

from locate.commands.console import err, out
from locate.journal.progress import progress_bars
from locate.pipeline.config import Lens


def calibrate(
    source: Annotated[Path, typer.Argument(help="A video or photos of the board.")],
    board: Annotated[
        str,
        typer.Option(help="9x6 inner corners of a chessboard, or charuco:4X4_50:7x5[:0.75]."),
    ],
    output: Annotated[
        Path, typer.Option("-o", "--output", help="The .json to write, for --camera.")
    ] = Path("camera.json"),
    lens: Annotated[Lens, typer.Option(help="auto takes the simplest that fits.")] = "auto",
) -> None:
    """Measure a lens by a chessboard or ChArUco board filmed from all sides: a file for --camera.

    Film with the zoom, the size and the stabilisation of the recordings that it is for.
    """
    from geometry.calibration_board import CalibrationBoard
    from locate.recording.calibrate import calibrate_recording

    known = CalibrationBoard.parse(board)
    with progress_bars(err) as report:
        written = calibrate_recording(
            source, known, output, lens=None if lens == "auto" else lens, report=report
        )
    found = written.found
    out.print(
        f"{found.lens}, focal length {found.camera.focal_px:.1f} px, {written.views} pictures of "
        f"the board: {found.rms_px:.2f} px rms, {found.others_px:.2f} px on boards not fitted to."
    )
    out.print(f"Camera:  {written.camera}", soft_wrap=True)
    out.print(f"Picture: {written.picture}", soft_wrap=True)
