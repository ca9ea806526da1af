"""A training at a glance: loss and validation AUROC by step, as a picture."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import cv2
import numpy as np

from detect.learning.checkpoint import read_journal
from geometry.image_files import write_image

WIDTH, HEIGHT, MARGIN, LEGEND = 900, 320, 60, 150
"""Of a panel, px."""
LATEST = 50
"""Losses that decide the scale of their panel."""
INK, PALE = (60, 60, 60), (225, 225, 225)
"""Colours of text and lines: blue, green, red."""
COLOURS = ((180, 119, 31), (14, 127, 255), (44, 160, 44), (40, 39, 214), (189, 103, 148),
           (75, 86, 140), (194, 119, 227))  # fmt: skip


class Curve(NamedTuple):
    """A line of a panel: what it shows, and its values by step."""

    name: str
    steps: Sequence[int]
    values: Sequence[float]


def plot_training(folder: Path, path: Path) -> Path:
    """Draws the journal of a training.

    Args:
        folder: Of the training.
        path: The picture to write, .png.

    Raises:
        BadInputError: There is no journal yet, or PATH is not writable.
    """
    lines = read_journal(folder)
    losses = [line for line in lines if line["kind"] == "train"]
    checks = [line for line in lines if line["kind"] == "validation"]
    end = max((line["step"] for line in lines), default=1)
    loss = Curve("loss", _journal_steps(losses), [line["loss"] for line in losses])
    families = sorted({name for line in checks for name in line["families"]})
    scores = [_auroc_curve(checks, name) for name in families]
    stages = _stage_starts(losses)
    panels = [
        _draw_panel("loss", [loss], end, (0.0, max([*loss.values[-LATEST:], 0.1]) * 1.5), stages),
        _draw_panel("validation AUROC", scores, end, (0.4, 1.0), stages),
    ]
    write_image(path, np.vstack(panels))
    return path


def _auroc_curve(checks: list[dict[str, Any]], family: str) -> Curve:
    known = [line for line in checks if family in line["families"]]
    aurocs = [line["families"][family]["auroc"] for line in known]
    return Curve(family, _journal_steps(known), aurocs)


def _journal_steps(lines: list[dict[str, Any]]) -> list[int]:
    return [line["step"] for line in lines]


def _stage_starts(losses: list[dict[str, Any]]) -> dict[str, int]:
    starts: dict[str, int] = {}
    for line in losses:
        starts.setdefault(line["stage"], line["step"])
    return starts


def _draw_panel(
    title: str, curves: list[Curve], end: int, span: tuple[float, float], stages: dict[str, int]
) -> np.ndarray:
    picture = np.full((HEIGHT, WIDTH, 3), 255, dtype=np.uint8)
    right, bottom = WIDTH - LEGEND, HEIGHT - MARGIN // 2
    low, high = span

    def place(step: float, value: float) -> tuple[int, int]:
        share = float(np.clip((value - low) / (high - low), 0, 1))
        x = MARGIN + (right - MARGIN) * step / end
        return round(x), round(bottom - (bottom - MARGIN) * share)

    for value in np.linspace(low, high, 5):
        cv2.line(picture, place(0, value), place(end, value), PALE, 1)
        _write_text(picture, f"{value:.2f}", (8, place(0, value)[1] + 4))
    for i, (name, step) in enumerate(stages.items()):
        cv2.line(picture, place(step, low), place(step, high), PALE, 2)
        _write_text(picture, name, (place(step, 0)[0] + 3, MARGIN - 4 - 12 * (i % 2)))
    _write_text(picture, f"{title}, {end} steps", (MARGIN, 18))
    for i, (name, steps, values) in enumerate(curves):
        colour = COLOURS[i % len(COLOURS)]
        known = [place(s, v) for s, v in zip(steps, values, strict=True) if np.isfinite(v)]
        cv2.polylines(picture, [np.array(known, np.int32)], False, colour, 2, cv2.LINE_AA)
        _write_text(picture, name, (right + 10, MARGIN + 20 * i), colour)
    return picture


def _write_text(
    picture: np.ndarray, text: str, at: tuple[int, int], colour: tuple[int, int, int] = INK
) -> None:
    cv2.putText(picture, text, at, cv2.FONT_HERSHEY_SIMPLEX, 0.4, colour, 1, cv2.LINE_AA)
