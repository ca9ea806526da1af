"""The scores by strength, views, arc and noise."""

import cv2
import numpy as np

from benchmarks.common.plots import text
from benchmarks.sensitivity.summary import COLOURS


def plot(summary: dict[str, dict[str, dict[str, float]]]) -> np.ndarray:
    """A column of panels for each numeric axis, a row for each score."""
    cases = {
        axis: [label for label in summary if label.startswith(f"{axis} ")]
        for axis in ("amplitude", "views", "arc", "noise")
    }
    cases = {axis: found for axis, found in cases.items() if len(found) > 1}
    fused_ = any("found" in scores["plain"] for scores in summary.values())
    rows = [
        np.hstack([panel(summary, labels_, axis, score) for axis, labels_ in cases.items()])
        for score in ("auroc", "ap", *(["found"] if fused_ else []))
    ]
    return np.vstack(rows)


def panel(
    summary: dict[str, dict[str, dict[str, float]]], cases: list[str], axis: str, score: str
) -> np.ndarray:
    image = np.full((300, 360, 3), 255, np.uint8)
    if not any(score in scores for case in cases for scores in summary[case].values()):
        return image
    least = 0.4 if score == "auroc" else 0.0
    for value in np.arange(least, 1.01, 0.1 if least else 0.2):
        row = round(240 - (value - least) / (1 - least) * 200)
        cv2.line(image, (45, row), (345, row), (225, 225, 225), 1)
        text(image, f"{value:.1f}", (18, row + 4))
    values = [float(case.split()[1]) for case in cases]
    units = {"amplitude": "px", "views": "key frames", "arc": "degrees", "noise": "of 255"}
    title = "Share found" if score == "found" else score.upper()
    text(image, f"{title} by {axis}, {units[axis]}", (45, 20))
    place = np.log(values) - np.log(min(values))
    columns = 50 + place / place.max() * 290
    for column, value in zip(columns, values, strict=True):
        text(image, f"{value:g}", (round(column) - 8, 256))
    for k, (name, colour) in enumerate(COLOURS.items()):
        points = [
            (column, 240 - (max(summary[case][name][score], least) - least) / (1 - least) * 200)
            for case, column in zip(cases, columns, strict=True)
            if score in summary[case].get(name, {})
        ]
        if points:
            line = np.round(points).astype(np.int32)
            width = 6 if name == "learned" else 2  # still seen where `fused` is the same
            cv2.polylines(image, [line], False, colour, width, cv2.LINE_AA)
            text(image, name, (20 + 66 * k, 284), colour)
    return image
