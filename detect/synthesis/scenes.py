"""Procedural man-made scenes: walls, windows, pipes, railings, bricks."""

from collections.abc import Callable

import cv2
import numpy as np

from geometry.arrays import FloatMap, GreyImage

SUBPIXEL_BITS = 4
TEXTURE = 0.08
GRAIN_PX = 6
TILT = 0.2
BLACK, WHITE = 12, 243


def man_made_scene(rng: np.random.Generator, side: int) -> FloatMap:
    """A wall with things on it, seen from a slant.

    Args:
        rng: Draws everything.
        side: Of the picture, in fine pixels.
    """
    wall = np.full((side, side), _draw_tone(rng), np.uint8)
    parts: list[Callable[[GreyImage, np.random.Generator, float], None]]
    parts = [_paint_fields, _paint_courses, _paint_windows, _paint_pipes, _paint_railing]
    chosen = rng.permutation(len(parts))[: rng.integers(2, len(parts) + 1)]
    unit = float(rng.uniform(8, 24))
    for i in sorted(chosen):
        parts[i](wall, rng, unit)
    radiance = _slant_picture(wall, rng).astype(np.float32) / 255
    grain = rng.standard_normal((side // GRAIN_PX, side // GRAIN_PX)).astype(np.float32)
    texture = TEXTURE * rng.random() * cv2.resize(grain, (side, side))
    return np.asarray(np.clip(radiance * (1 + texture), 0, 1), dtype=np.float32)


def _draw_tone(rng: np.random.Generator) -> int:
    return int(rng.integers(BLACK, WHITE))


def _fill_polygon(image: GreyImage, corners: np.ndarray, tone: float) -> None:
    """Paints a convex polygon, (N, 2) corners in fine pixels, with smooth edges."""
    points = np.rint(np.asarray(corners) * 2**SUBPIXEL_BITS).astype(np.int32)
    cv2.fillConvexPoly(image, points, float(tone), cv2.LINE_AA, SUBPIXEL_BITS)


def _fill_box(
    image: GreyImage, x: float, y: float, width: float, height: float, tone: float
) -> None:
    corners = [(x, y), (x + width, y), (x + width, y + height), (x, y + height)]
    _fill_polygon(image, np.array(corners), tone)


def _paint_fields(image: GreyImage, rng: np.random.Generator, _unit: float) -> None:
    """A few large areas: sky, ground, other walls, roofs."""
    side = len(image)
    for _ in range(rng.integers(1, 4)):
        middle, angle = rng.uniform(0, side, 2), rng.choice([0.0, np.pi / 2]) + rng.normal(0, 0.2)
        along = np.array([np.cos(angle), np.sin(angle)]) * 3 * side
        across = np.array([-along[1], along[0]]) * rng.uniform(0.05, 0.5)
        ends = [middle - along, middle + along]
        _fill_polygon(
            image, np.array([ends[0], ends[1], ends[1] + across, ends[0] + across]), _draw_tone(rng)
        )


def _paint_courses(image: GreyImage, rng: np.random.Generator, unit: float) -> None:
    """Bricks, or boards where the wall has no upright joints."""
    side = len(image)
    height, length = unit, unit * rng.uniform(2, 3)
    joint = max(unit * rng.uniform(0.06, 0.15), 1.5)
    bricks, spread = rng.random() < 0.6, rng.uniform(0, 25)
    mean = _draw_tone(rng)
    image[:] = np.clip(mean + rng.choice([-1, 1]) * rng.uniform(20, 70), BLACK, WHITE)
    for row in range(int(side / height) + 1):
        start = -length * rng.uniform(0, 1) if bricks else 0.0
        width = length if bricks else float(side)
        while start < side:
            tone = np.clip(mean + rng.normal(0, spread), BLACK, WHITE)
            gap = joint if bricks else 0.0
            _fill_box(image, start, row * height, width - gap, height - joint, tone)
            start += width


def _paint_windows(image: GreyImage, rng: np.random.Generator, unit: float) -> None:
    """Rows of framed panes on a sill."""
    side = len(image)
    width, height = unit * rng.uniform(4, 8), unit * rng.uniform(5, 10)
    step = np.array([width, height]) * rng.uniform(1.3, 2)
    glass, frame, sill = _draw_tone(rng) * 0.6, _draw_tone(rng), _draw_tone(rng)
    bar = unit * rng.uniform(0.3, 0.7)
    columns, rows = int(rng.integers(1, 4)), int(rng.integers(1, 4))
    pane = (width - bar * (columns + 1)) / columns, (height - bar * (rows + 1)) / rows
    left, top = rng.uniform(-1, 0.5, 2) * step
    for x in np.arange(left, side, step[0]):
        for y in np.arange(top, side, step[1]):
            _fill_box(image, x, y, width, height, frame)
            _fill_box(image, x - bar, y + height, width + 2 * bar, bar, sill)
            for i, j in np.ndindex(columns, rows):
                corner = x + bar + i * (pane[0] + bar), y + bar + j * (pane[1] + bar)
                tone = np.clip(glass + rng.normal(0, 8), BLACK, WHITE)
                _fill_box(image, *corner, *pane, tone)


def _paint_pipes(image: GreyImage, rng: np.random.Generator, unit: float) -> None:
    """Round pipes, lit from one side, with collars."""
    side = len(image)
    strips = 24
    shade = np.sqrt(1 - np.linspace(-0.99, 0.99, strips) ** 2)
    upright = rng.random() < 0.5
    for _ in range(rng.integers(1, 5)):
        width, tone, place = unit * rng.uniform(0.6, 3), _draw_tone(rng), rng.uniform(0, side)
        light = np.clip(np.roll(shade, int(rng.integers(-5, 6))) * tone, BLACK, WHITE)
        lengths = [(0.0, float(side), 1.0)]
        lengths += [(float(rng.uniform(0, side)), 0.7 * width, 1.35) for _ in range(2)]
        for start, length, wider in lengths:
            edge = place - width * wider / 2
            thin = width * wider / strips
            for k in range(strips):
                box = (edge + k * thin, start, thin + 0.5, length)
                box = box if upright else (box[1], box[0], box[3], box[2])
                _fill_box(image, *box, light[k])


def _paint_railing(image: GreyImage, rng: np.random.Generator, unit: float) -> None:
    """Posts and bars between two rails."""
    side = len(image)
    tone, pitch = _draw_tone(rng), unit * rng.uniform(0.8, 2)
    top, height = rng.uniform(-0.1, 0.7) * side, rng.uniform(0.3, 0.6) * side
    bar = pitch * rng.uniform(0.15, 0.35)
    for x in np.arange(rng.uniform(-pitch, 0), side, pitch):
        _fill_box(image, x, top, bar, height, tone)
    for y in (top, top + height):
        _fill_box(image, 0, y, side, 1.6 * bar, tone)


def _slant_picture(image: GreyImage, rng: np.random.Generator) -> GreyImage:
    """The picture turned a little and seen in perspective."""
    side = float(len(image))
    corners = np.array([[0, 0], [side, 0], [side, side], [0, side]])
    angle = rng.normal(0, 0.15)
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    larger = 1.25 * (corners - side / 2) @ turn.T + side / 2
    target = larger + rng.uniform(0, TILT, (4, 2)) * (larger - side / 2)
    matrix = cv2.getPerspectiveTransform(corners.astype(np.float32), target.astype(np.float32))
    shape = (int(side), int(side))
    return np.asarray(
        cv2.warpPerspective(
            image, matrix, shape, flags=cv2.INTER_LINEAR, borderMode=cv2.BORDER_REFLECT_101
        ),
        dtype=np.uint8,
    )
