"""`locate pattern`."""

from pathlib import Path
from typing import Annotated, Literal

import numpy as np
import typer

from geometry.arrays import GreyImage
from geometry.errors import BadInputError
from locate.commands.console import out

Kind = Literal["checkerboard", "sinusoid", "perlin", "squares"]
MM_PER_INCH = 25.4
LEAST_DOTS = 4.0
"""Of one period, so that the printer resolves it; chosen."""
LEAST_PERIODS = 2.0
"""Across the shorter side of a page, without which it shows no pattern; chosen."""
MOST_DOTS = 4e8
"""Of a page; bounds memory."""
LEAST_PERIOD_PX = 3.0
"""Shortest period that a camera resolves."""


def pattern(
    kind: Annotated[Kind, typer.Argument(help="What to print.")],
    output: Annotated[Path, typer.Option("-o", "--output", help="The .pdf or .png to write.")],
    period_mm: Annotated[
        float | None, typer.Option(min=0.01, help="Of the finest detail, on paper.")
    ] = None,
    period_px: Annotated[
        float | None, typer.Option(min=LEAST_PERIOD_PX, help="The same, in the camera's image.")
    ] = None,
    range_m: Annotated[
        float | None, typer.Option(min=0.01, help="From the camera to the background.")
    ] = None,
    focal: Annotated[float | None, typer.Option(min=1e-6, help="Focal length in px.")] = None,
    paper: Annotated[str, typer.Option(help="A4 to A0, or a size such as 297x210mm.")] = "A4",
    dpi: Annotated[float, typer.Option(min=36, max=2400, help="Dots per inch.")] = 300,
    margin_mm: Annotated[float, typer.Option(min=0, help="White edge for the printer.")] = 10,
    seed: Annotated[int, typer.Option(min=0, help="Of perlin and squares.")] = 0,
) -> None:
    """Print a background for `locate bos`: give --period-mm, or period in px, range and focal."""
    from detect.synthesis.printed_page import pattern as draw
    from detect.synthesis.printed_page import rasterise_page
    from locate.printing.sheet import paper_mm, write_sheet

    period = find_period_mm(period_mm, period_px, range_m, focal)
    page = paper_mm(paper)
    _check_dots(page, period, dpi, margin_mm)
    image = rasterise_page(draw(kind, period, seed=seed, page_mm=page), page, dpi)
    _whiten_margin(image, page, margin_mm, dpi)
    about = f"{kind}, period {period:.3f} mm, seed {seed}"
    caption = f"100 mm: print at 100 %. {about}" if margin_mm > 0 else None
    write_sheet(output, image, dpi, page, caption)
    out.print(f"{about}, {page[0]:g} x {page[1]:g} mm: {output}", soft_wrap=True)


def find_period_mm(
    period_mm: float | None, period_px: float | None, range_m: float | None, focal: float | None
) -> float:
    """The period on paper: as given, or what covers `period_px` of the image at that range.

    Raises:
        BadInputError: Neither is given, or both.
    """
    by_camera = (period_px, range_m, focal)
    if period_mm is not None and by_camera == (None, None, None):
        return period_mm
    if period_mm is None and period_px and range_m and focal:
        return period_px * range_m * 1000 / focal
    raise BadInputError("give either --period-mm, or --period-px with --range-m and --focal")


def _check_dots(page: tuple[float, float], period: float, dpi: float, margin: float) -> None:
    width, height = (side / MM_PER_INCH * dpi for side in page)
    dots = period / MM_PER_INCH * dpi
    if dots < LEAST_DOTS:
        raise BadInputError(f"a period of {period:.3g} mm is {dots:.1f} dots; raise --dpi")
    if not period * LEAST_PERIODS <= min(page):
        raise BadInputError(
            f"a period of {period:.3g} mm is too large for a page of {page[0]:g} x {page[1]:g} mm: "
            "choose a larger --paper or a shorter period"
        )
    if width * height > MOST_DOTS:
        raise BadInputError(f"{width:.0f} x {height:.0f} dots are too many; lower --dpi")
    if 2 * margin >= min(page):
        raise BadInputError(f"--margin-mm {margin:g} leaves nothing of the page")


def _whiten_margin(image: GreyImage, page: tuple[float, float], margin: float, dpi: float) -> None:
    """Makes every dot white whose middle is in the margin."""
    columns, rows = ((np.arange(count) + 0.5) * MM_PER_INCH / dpi for count in image.shape[::-1])
    image[(rows < margin) | (rows > page[1] - margin)] = 255
    image[:, (columns < margin) | (columns > page[0] - margin)] = 255
