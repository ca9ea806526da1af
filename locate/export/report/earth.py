"""Where the plumes of the report are on the Earth: coordinates, and a plan without a basemap."""

from html import escape
from string import Template

import numpy as np

from geometry.arrays import FloatArray
from geometry.trajectory import Trajectory
from locate.export.html import read_resource
from locate.export.located import ELLIPSE_SIGMAS, LocatedPlume, plumes_on_earth
from locate.export.report.layout import PLUME_COLORS, scene_bounds
from locate.map.plume import Plume, PlumeMap

WIDTH = 640.0
"""Of the plan in its own units."""
TALLEST = 1.2
"""Most height of the plan, in widths."""
MOST_POINTS = 1500
BAR_SHARE = 0.3
"""Most length of the scale bar, in widths of the plan."""
MARGIN = 16.0
"""Of the scale bar, as in plan.svg."""
AROUND = 48
"""Corners of an ellipse."""


def earth_section(
    plume_map: PlumeMap, trajectory: Trajectory | None, points_in_world: FloatArray
) -> str:
    """HTML with the coordinates and the plan; empty where the map is not on the Earth.

    Args:
        plume_map: The answer.
        trajectory: The cameras, in local east-north-up.
        points_in_world: (N, 3) of the scene.
    """
    if plume_map.georeference is None or trajectory is None:
        return ""
    places = "".join(f"<li>{_place_text(one)}</li>" for one in plumes_on_earth(plume_map))
    return Template(read_resource("report/earth.html")).substitute(
        places=places, plan=_plan(plume_map, trajectory, points_in_world)
    )


def _place_text(place: LocatedPlume) -> str:
    where = f"{place.lat_deg:.7f}, {place.lon_deg:.7f}"
    point = f"{place.lat_deg:.7f}/{place.lon_deg:.7f}"
    page = (
        f"https://www.openstreetmap.org/?mlat={place.lat_deg:.7f}&mlon={place.lon_deg:.7f}"
        f"#map=19/{point}"
    )
    height = f"{place.height_m:.1f} m above {place.datum.words}"
    return (
        f"{escape(place.name)}: <b>{where}</b> (WGS84), {escape(height)}. "
        f'<a href="{escape(page)}" rel="noreferrer">{escape(place.name)} on OpenStreetMap</a>, '
        f'<a href="geo:{place.lat_deg:.7f},{place.lon_deg:.7f}">{escape(place.name)} in a map '
        "program</a>"
    )


def _plan(plume_map: PlumeMap, trajectory: Trajectory, points_in_world: FloatArray) -> str:
    """SVG from above, north up: points of the scene, the camera's path, sources, a scale bar."""
    centers = trajectory.centers_in_world
    low, high = (corner[:2] for corner in scene_bounds(plume_map, centers, points_in_world))
    high = np.maximum(high, low + (high - low).max() / 4)
    scale = WIDTH / max(high[0] - low[0], (high[1] - low[1]) / TALLEST)
    height = scale * (high[1] - low[1])

    def place(points: FloatArray) -> FloatArray:
        """(N, 2) on the plan."""
        return np.asarray((points[:, :2] - low) * [scale, -scale] + [0.0, height])

    flat = points_in_world[:, :2]
    inside = flat[((flat >= low) & (flat <= high)).all(axis=1)]
    step = max(1, -(-len(inside) // MOST_POINTS))
    length_m = _round_length(BAR_SHARE * WIDTH / scale)
    return Template(read_resource("report/plan.svg")).substitute(
        width=f"{WIDTH:.0f}",
        height=f"{height:.0f}",
        points="".join(f"M{x:.1f} {y:.1f}h0" for x, y in place(inside[::step])),
        path=_corners(place(centers)),
        sources="".join(
            _source(plume, place(plume.source[None])[0], place(_ellipse(plume)))
            for plume in plume_map.plumes
        ),
        bar_right=f"{MARGIN + scale * length_m:.1f}",
        bar_y=f"{height - MARGIN:.1f}",
        text_y=f"{height - 1.6 * MARGIN:.1f}",
        length=f"{length_m:g} m",
    )


def _ellipse(plume: Plume) -> FloatArray:
    """(N, 2) the 95 % ellipse of the horizontal position, local east-north-up."""
    angles = np.linspace(0.0, 2 * np.pi, AROUND, endpoint=False)
    root = np.linalg.cholesky(plume.source_covariance[:2, :2] + 1e-12 * np.eye(2))
    circle = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    return np.asarray(plume.source[:2] + ELLIPSE_SIGMAS * circle @ root.T)


def _source(plume: Plume, center: FloatArray, ellipse: FloatArray) -> str:
    x, y = center
    color = PLUME_COLORS[(plume.id - 1) % len(PLUME_COLORS)]
    return (
        f'<g style="color:{color}"><polygon points="{_corners(ellipse)}"/>'
        f'<circle cx="{x:.1f}" cy="{y:.1f}" r="4"/></g>'
        f'<text x="{x + 9:.1f}" y="{y - 7:.1f}">Plume {plume.id}</text>'
    )


def _corners(points: FloatArray) -> str:
    return " ".join(f"{x:.1f},{y:.1f}" for x, y in points)


def _round_length(most: float) -> float:
    """The largest of 1, 2 and 5 times a power of ten that is no more than `most`."""
    power = 10.0 ** np.floor(np.log10(most))
    return float(max(step * power for step in (1, 2, 5) if step * power <= most))
