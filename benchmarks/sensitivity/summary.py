"""Medians over scenes, and their table."""

import numpy as np

from benchmarks.sensitivity.conditions import Condition

COLOURS = {
    "dybs": (150, 150, 150),
    "plain": (60, 160, 60),
    "learned": (200, 120, 30),
    "fused": (30, 60, 200),
    "ideal": (0, 0, 0),
}


def label_of(axis: str, condition: Condition) -> str:
    if axis == "nuisance":
        plume = "with" if condition.amplitude_px else "without"
        return f"{condition.nuisance or 'none'}, {plume} a plume"
    if axis == "coding":
        return condition.nuisance or "lossless"
    values = {"amplitude": condition.amplitude_px, "noise": condition.noise,
              "arc": condition.arc_deg, "views": condition.views}  # fmt: skip
    return f"{values[axis]:g}"


def summarise(results: list[dict[str, dict[str, float]]]) -> dict[str, dict[str, float]]:
    """Medians over scenes; the share found and the false plumes a scene are means."""
    summary: dict[str, dict[str, float]] = {}
    for name in COLOURS:
        known = [result[name] for result in results if name in result]
        if known:
            means = ("found", "false_plumes")
            keys = sorted({key for scores in known for key in scores})
            summary[name] = {"scenes": len(known)} | {
                key: float(
                    (np.mean if key in means else np.median)([s[key] for s in known if key in s])
                )
                for key in keys
            }
    return summary


def table(summary: dict[str, dict[str, dict[str, float]]]) -> str:
    lines = ["| case | contender | scenes | AUROC | AP | pixels falsely above 1 nat | found "
             "| source error, % of range | false plumes a scene | SNR of the whole plume |",
             "|" + "---|" * 10]  # fmt: skip
    shapes = {"scenes": ".0f", "auroc": ".3f", "ap": ".3f", "false_pixels": ".4f", "found": ".2f",
              "error_percent": ".1f", "false_plumes": ".2f", "whole_plume_snr": ".0f"}  # fmt: skip
    for label, contenders in summary.items():
        for name, scores in contenders.items():
            cells = [f"{scores[key]:{shape}}" if key in scores else ""
                     for key, shape in shapes.items()]  # fmt: skip
            lines.append(f"| {label} | {name} | " + " | ".join(cells) + " |")
    return "\n".join(lines)
