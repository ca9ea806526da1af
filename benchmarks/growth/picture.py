"""How time, memory and disk grow, drawn from the tables of the other commands.

    python -m benchmarks.growth picture -o docs/images/growth.png [--tables DIR]

A panel for each table, both axes logarithmic. The grey line through the first time is linear.
"""

import argparse
from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np

from benchmarks.common.csv_tables import DOCS, Row, read_table
from benchmarks.common.growth import EXPONENT
from benchmarks.common.plots import Colour, blank, text
from benchmarks.growth.run import CPU, DISK, MEMORY
from geometry.arrays import FloatArray
from geometry.image_files import write_image

TABLES = ("growth_video", "growth_photos", "growth_sizes", "growth_plumes", "survey_joining")
COLOURS: dict[str, Colour] = {CPU: (40, 40, 210), MEMORY: (170, 90, 20), DISK: (60, 140, 60)}
LINEAR: Colour = (200, 200, 200)
WIDTH, HEIGHT, PANELS_A_ROW = 330, 280, 3
LEFT, RIGHT, TOP, BOTTOM = 48, 310, 64, 240
LEAST, MOST = 1e-2, 1e4
"""The range of the vertical axis, s and MiB."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("-o", "--output", type=Path, default=Path("work/growth.png"))
    parser.add_argument("--tables", type=Path, default=DOCS)


def main(options: argparse.Namespace) -> None:
    panels = [panel(read_table(options.tables / f"{name}.csv")) for name in TABLES]
    options.output.parent.mkdir(parents=True, exist_ok=True)
    write_image(options.output, arranged(panels))


def arranged(panels: Sequence[np.ndarray]) -> np.ndarray:
    """The panels in rows, the last filled with white."""
    filled = [*panels, *[blank(HEIGHT, WIDTH)] * (-len(panels) % PANELS_A_ROW)]
    starts = range(0, len(filled), PANELS_A_ROW)
    return np.vstack([np.hstack(filled[k : k + PANELS_A_ROW]) for k in starts])


def panel(rows: Sequence[Row]) -> np.ndarray:
    """Each cost of a table over its first column."""
    title = next(iter(rows[0]))
    fitted = {name: row[name] for row in rows if row[title] == EXPONENT for name in row}
    sizes = np.array([float(row[title]) for row in rows if row[title] != EXPONENT])
    image = blank(HEIGHT, WIDTH)
    text(image, f"{title}: exponents", (LEFT, 18))
    for power in range(round(np.log10(LEAST)), round(np.log10(MOST)) + 1):
        (height,) = heights(np.array([10.0**power]))
        cv2.line(image, (LEFT, height), (RIGHT, height), (235, 235, 235), 1)
        text(image, f"{10.0**power:g}", (8, height + 4))
    places = columns(sizes)
    for place, size in zip(places, sizes, strict=True):
        text(image, f"{size:g}", (place - 4 * len(f"{size:g}"), BOTTOM + 20))
    times = [float(row[CPU]) for row in rows[: len(sizes)]]
    draw(image, places, times[0] * sizes / sizes[0], LINEAR)
    for k, name in enumerate(name for name in COLOURS if name in rows[0]):
        values = np.array([float(row[name]) for row in rows[: len(sizes)]])
        draw(image, places, values, COLOURS[name])
        slope = fitted.get(name, "-")
        text(image, f"{name}: {slope}", (LEFT + 90 * k, 40), COLOURS[name])
    return image


def draw(image: np.ndarray, places: Sequence[int], values: FloatArray, colour: Colour) -> None:
    """A line through values of at least `LEAST`."""
    points = list(zip(places, heights(values), strict=True))
    shown = np.array([p for p, value in zip(points, values, strict=True) if value >= LEAST])
    if len(shown):
        cv2.polylines(image, [shown.astype(np.int32)], False, colour, 2, cv2.LINE_AA)


def columns(sizes: FloatArray) -> list[int]:
    """Of ascending sizes, px."""
    share = np.log(sizes / sizes[0]) / np.log(sizes[-1] / sizes[0])
    return [round(LEFT + 8 + each * (RIGHT - LEFT - 16)) for each in share.tolist()]


def heights(values: FloatArray) -> list[int]:
    """Of values in s and MiB, px."""
    share = np.log(np.clip(values, LEAST, MOST) / LEAST) / np.log(MOST / LEAST)
    return [round(BOTTOM - each * (BOTTOM - TOP)) for each in share.tolist()]
