"""The frame of the 3D scene: what it spans, its axes, close-ups and viewpoint."""

from typing import Any

import numpy as np

from geometry.arrays import FloatArray
from locate.map.plume import PlumeMap

# Okabe and Ito's palette, readable with any kind of colour vision.
PLUME_COLORS = ("#d55e00", "#cc79a7", "#009e73", "#e69f00", "#56b4e9")
CAMERA_COLOR = "#0072b2"
POINT_COLOR = "#8a8f98"


def scene_bounds(
    plume_map: PlumeMap, centers: FloatArray, points: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """The box to draw: all cameras and plumes, and the sparse points around them."""
    parts = [centers]
    for plume in plume_map.plumes:
        ends = np.array([min(plume.extent_low, 0.0), plume.extent_high])
        parts.append(plume.points_on_axis(ends))
    if not plume_map.plumes and len(points):
        parts.append(np.percentile(points, [25, 75], axis=0))
    core = np.concatenate(parts)
    reach = 0.35 * float(np.linalg.norm(np.ptp(core, axis=0)))
    low, high = core.min(axis=0) - reach, core.max(axis=0) + reach
    near = points[((points >= low) & (points <= high)).all(axis=1)]
    if len(near):
        core = np.concatenate([core, np.percentile(near, [2, 98], axis=0)])
    margin = 0.05 * float(np.ptp(core, axis=0).max())
    return core.min(axis=0) - margin, core.max(axis=0) + margin


def scene_layout(
    plume_map: PlumeMap, low: FloatArray, high: FloatArray, centers: FloatArray
) -> dict[str, Any]:
    """Axes of one scale, legend and viewpoint of the scene between `low` and `high`."""
    names = ("east", "north", "up") if plume_map.georeference else ("x", "y", "z")
    axes = {
        f"{key}axis": {
            "title": {"text": f"{name} ({plume_map.unit_name})"},
            "range": [float(low[k]), float(high[k])],
            "backgroundcolor": "rgba(0,0,0,0)",
            "showspikes": False,
        }
        for k, (key, name) in enumerate(zip("xyz", names, strict=True))
    }
    clear = "rgba(0,0,0,0)"
    return {
        "scene": {
            **axes,
            "aspectmode": "manual",
            "aspectratio": _box_proportions(low, high),
            "camera": _viewpoint(low, high, centers),
        },
        "margin": {"l": 0, "r": 0, "t": 0, "b": 0},
        "legend": {
            "orientation": "h",
            "x": 0.5,
            "xanchor": "center",
            "y": 0.01,
            "bgcolor": clear,
            "itemsizing": "constant",
            "tracegroupgap": 0,
        },
        "paper_bgcolor": clear,
        "modebar": {"bgcolor": clear, "color": POINT_COLOR, "activecolor": PLUME_COLORS[0]},
        "uirevision": "keep",
    }


def close_ups(plume_map: PlumeMap, low: FloatArray, high: FloatArray) -> dict[str, Any]:
    """What to change of the layout to zoom to a plume or back, by the name on its button."""
    boxes = {"Everything": (low, high)}
    for plume in plume_map.plumes:
        ends = plume.points_on_axis(np.array([0.0, plume.extent_high]))
        margin = 0.35 * plume.extent_high + 2 * plume.principal_sigmas[0]
        boxes[f"Plume {plume.id}"] = (ends.min(axis=0) - margin, ends.max(axis=0) + margin)
    zooms = {name: _zoom_update(near, far) for name, (near, far) in boxes.items()}
    return zooms if plume_map.plumes else {}


def _zoom_update(low: FloatArray, high: FloatArray) -> dict[str, Any]:
    ranges = {
        f"scene.{key}axis.range": [float(low[k]), float(high[k])] for k, key in enumerate("xyz")
    }
    return ranges | {"scene.aspectratio": _box_proportions(low, high)}


def _box_proportions(low: FloatArray, high: FloatArray) -> dict[str, float]:
    """Sides of the box with the volume of a unit cube, so that a metre is a metre on each axis."""
    sides = high - low
    return dict(zip("xyz", (sides / np.cbrt(np.prod(sides))).tolist(), strict=True))


def _viewpoint(low: FloatArray, high: FloatArray, centers: FloatArray) -> dict[str, Any]:
    """Behind the cameras, a little to the side and above."""
    x, y, _ = centers.mean(axis=0) - (low + high) / 2
    bearing = np.arctan2(y, x) + np.radians(35)
    eye = {"x": 1.5 * np.cos(bearing), "y": 1.5 * np.sin(bearing), "z": 0.75}
    return {"eye": eye, "center": {"x": 0, "y": 0, "z": -0.16}, "up": {"x": 0, "y": 0, "z": 1}}
