"""A plan as a picture: how strong the plume looks by the range of the camera."""

from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from geometry.arrays import FloatArray
from geometry.image_files import write_image
from locate.planning.plan import NEEDED_PX, Plan

WIDTH, HEIGHT = 900, 560
LEFT, RIGHT, TOP, BOTTOM = 80, 30, 60, 60
INK, PALE, CURVE, HERE, WANTED = (
    (50, 50, 50),
    (225, 225, 225),
    (180, 119, 31),
    (40, 39, 214),
    (44, 160, 44),
)
"""BGR."""
RANGES = np.geomspace(0.25, 4.0, 60)
"""Of the planned range, the ranges that are drawn."""
TICKS = np.outer(10.0 ** np.arange(-4, 4), [1, 2, 5]).ravel()


@dataclass(frozen=True)
class _Axes:
    """Where range and strength are in the picture; both are logarithmic."""

    ranges_m: tuple[float, float]
    strengths_px: tuple[float, float]

    def place(self, range_m: float, strength_px: float) -> tuple[int, int]:
        x = _share(range_m, *self.ranges_m)
        y = _share(strength_px, *self.strengths_px)
        return (
            round(LEFT + (WIDTH - LEFT - RIGHT) * x),
            round(HEIGHT - BOTTOM - (HEIGHT - TOP - BOTTOM) * y),
        )


def draw_plan(plan: Plan, path: Path) -> Path:
    """Draws the strength by range, the background as far behind the plume as planned.

    Raises:
        BadInputError: PATH cannot be written.
    """
    here_m, wanted_px = plan.view.range_to_plume_m, NEEDED_PX[plan.coding]
    ranges_m = here_m * RANGES
    strengths_px = np.array([plan.at_range(float(range_m)).strength_px for range_m in ranges_m])
    shown = np.array([*strengths_px, wanted_px])
    axes = _Axes(
        (float(ranges_m[0]), float(ranges_m[-1])),
        (max(float(shown.min()) / 1.5, 1e-4), float(shown.max()) * 1.5),
    )
    picture = np.full((HEIGHT, WIDTH, 3), 255, dtype=np.uint8)
    _draw_grid(picture, axes)
    _draw_level(picture, axes, wanted_px)
    _draw_curve(picture, axes, ranges_m, strengths_px)
    at = axes.place(here_m, plan.strength_px)
    cv2.circle(picture, at, 6, HERE, -1, cv2.LINE_AA)
    _write(picture, f"planned: {plan.strength_px:.3g} px", (at[0] + 10, at[1] - 10), HERE)
    _write(picture, "strength of the plume in the image (px) by range to it (m)", (LEFT, 28))
    write_image(path, picture)
    return path


def _share(value: float, low: float, high: float) -> float:
    return float(np.log(np.clip(value, low, high) / low) / np.log(high / low))


def _draw_grid(picture: np.ndarray, axes: _Axes) -> None:
    (near, far), (weak, strong) = axes.ranges_m, axes.strengths_px
    for tick in TICKS[(near <= TICKS) & (far >= TICKS)]:
        cv2.line(picture, axes.place(tick, weak), axes.place(tick, strong), PALE, 1)
        _write(picture, f"{tick:g}", (axes.place(tick, weak)[0] - 8, HEIGHT - BOTTOM + 20))
    for tick in TICKS[(weak <= TICKS) & (strong >= TICKS)]:
        cv2.line(picture, axes.place(near, tick), axes.place(far, tick), PALE, 1)
        _write(picture, f"{tick:g}", (20, axes.place(near, tick)[1] + 5))


def _draw_level(picture: np.ndarray, axes: _Axes, wanted_px: float) -> None:
    near, far = axes.ranges_m
    start = axes.place(near, wanted_px)
    cv2.line(picture, start, axes.place(far, wanted_px), WANTED, 2, cv2.LINE_AA)
    _write(picture, f"wanted: {wanted_px:g} px", (start[0] + 8, start[1] - 8), WANTED)


def _draw_curve(
    picture: np.ndarray, axes: _Axes, ranges_m: FloatArray, strengths_px: FloatArray
) -> None:
    points = [
        axes.place(range_m, strength_px)
        for range_m, strength_px in zip(ranges_m, strengths_px, strict=True)
    ]
    cv2.polylines(picture, [np.array(points, np.int32)], False, CURVE, 2, cv2.LINE_AA)


def _write(
    picture: np.ndarray, text: str, at: tuple[int, int], colour: tuple[int, int, int] = INK
) -> None:
    cv2.putText(picture, text, at, cv2.FONT_HERSHEY_SIMPLEX, 0.5, colour, 1, cv2.LINE_AA)
