"""The 3D scene as a Plotly figure: plain data that plotly.js draws."""

from base64 import b64encode
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from geometry.arrays import BoolArray, FloatArray
from geometry.trajectory import Trajectory
from locate.export.report import layout, shapes
from locate.export.report.layout import CAMERA_COLOR, PLUME_COLORS
from locate.export.report.pictures import heat_stops
from locate.map.plume import Plume, PlumeMap

N_SIGMA = 2.0
"""Size of the ellipsoid at a source, standard deviations."""
_COLORSCALE = [[i / 7, color] for i, color in enumerate(heat_stops(8))]
POINT_GREY = 140
MAX_POINTS, MAX_VOXELS, MAX_FRUSTA = 8000, 8000, 36
"""Drawn at most; bounds the size of the file."""

Trace = dict[str, Any]


@dataclass(frozen=True)
class ColouredPoints:
    """Points of the scene.

    Attributes:
        in_world: (N, 3).
        colours: (N, 3) uint8 red, green, blue.
    """

    in_world: FloatArray
    colours: NDArray[np.uint8]

    @classmethod
    def grey(cls, in_world: FloatArray) -> Self:
        """Points of which no colour is known."""
        return cls(in_world, np.full((len(in_world), 3), POINT_GREY, dtype=np.uint8))

    def take(self, chosen: BoolArray) -> Self:
        """Some of them."""
        return type(self)(self.in_world[chosen], self.colours[chosen])


def scene_figure(
    plume_map: PlumeMap,
    trajectory: Trajectory,
    points: ColouredPoints,
    voxels_in_world: FloatArray,
    voxel_probability: FloatArray,
    shown: Sequence[int],
) -> dict[str, Any]:
    """``{"data": traces, "layout": layout, "close_ups": changes of it}`` for plotly.js.

    Args:
        plume_map: Plumes.
        trajectory: Cameras.
        points: Of the scene.
        voxels_in_world: (V, 3) with evidence.
        voxel_probability: (V,).
        shown: Indices of the frames that the page shows.
    """
    centers = trajectory.centers_in_world
    low, high = layout.scene_bounds(plume_map, centers, points.in_world)
    within = np.all((points.in_world >= low) & (points.in_world <= high), axis=1)
    size = 0.03 * float(np.linalg.norm(high - low))
    traces = [
        _point_trace(points.take(np.asarray(within))),
        *_camera_traces(trajectory, size, shown),
        *_voxel_traces(voxels_in_world, voxel_probability, plume_map.plumes),
    ]
    for plume in plume_map.plumes:
        traces += _plume_traces(plume, plume_map.unit_name)
    return {
        "data": traces,
        "layout": layout.scene_layout(plume_map, low, high, centers),
        "close_ups": layout.close_ups(plume_map, low, high),
    }


def _point_trace(points: ColouredPoints) -> Trace:
    step = max(1, -(-len(points.in_world) // MAX_POINTS))
    trace = _scatter_trace(points.in_world[::step], name="scene points", size=1.6, color="")
    trace["marker"]["color"] = [f"#{bytes(rgb).hex()}" for rgb in points.colours[::step]]
    return trace | {"hoverinfo": "skip"}


def _camera_traces(trajectory: Trajectory, size: float, shown: Sequence[int]) -> list[Trace]:
    n = len(trajectory)
    rows = np.unique(np.linspace(0, n - 1, min(n, MAX_FRUSTA)).astype(np.int64))
    centers = trajectory.centers_in_world
    path = _line_trace(centers, name="camera path", color=CAMERA_COLOR, width=5) | {
        "customdata": trajectory.indices.tolist(),
        "hovertemplate": "frame %{customdata}<extra></extra>",
        "legendgroup": "camera",
        "meta": {"click": "frame"},
    }
    opened = np.flatnonzero(np.isin(trajectory.indices, shown))
    dots = _scatter_trace(centers[opened], name="", size=5, color=CAMERA_COLOR) | {
        "customdata": trajectory.indices[opened].tolist(),
        "hovertemplate": "frame %{customdata}: click to see it<extra></extra>",
        "showlegend": False,
        "legendgroup": "camera",
        "meta": {"click": "frame"},
    }
    wires = _line_trace(
        shapes.camera_frusta(trajectory, rows, size), name="", color=CAMERA_COLOR, width=1.5
    )
    return [path, dots, wires | {"hoverinfo": "skip", "showlegend": False, "legendgroup": "camera"}]


def _voxel_traces(
    voxels: FloatArray, probability: FloatArray, plumes: Sequence[Plume]
) -> list[Trace]:
    if len(voxels) == 0:
        return []
    strongest = np.argsort(probability)[::-1][:MAX_VOXELS]
    size, opacity = (2.2, 0.2) if len(strongest) > 1000 else (4.0, 0.45)
    trace = _scatter_trace(voxels[strongest], name="evidence", size=size, color="")
    trace["marker"] |= {
        "color": _typed_array(probability[strongest]),
        "colorscale": _COLORSCALE,
        "cmin": 0,
        "cmax": 1,
        "opacity": opacity,
    }
    if plumes:
        away = [
            np.linalg.norm(np.cross(voxels[strongest] - p.source, p.axis), axis=1) for p in plumes
        ]
        trace["customdata"] = [plumes[nearest].id for nearest in np.argmin(away, axis=0)]
        trace["meta"] = {"click": "plume"}
    trace["hovertemplate"] = "%{marker.color:.2f}, 0.5 = none<extra>evidence</extra>"
    return [trace]


def _plume_traces(plume: Plume, unit: str) -> list[Trace]:
    color = PLUME_COLORS[(plume.id - 1) % len(PLUME_COLORS)]
    group = {
        "legendgroup": f"plume {plume.id}",
        "meta": {"click": "plume", "plume": plume.id},
    }
    x, y, z = plume.source
    place = f"plume {plume.id}<br>{x:.3f}, {y:.3f}, {z:.3f} {unit}"
    source = _scatter_trace(plume.source[None], name=f"source {plume.id}", size=4, color=color) | {
        "hovertemplate": f"{place}<extra></extra>",
        "showlegend": False,
    }
    traces = [source]
    if len(plume.radius_by_height) > 1:
        traces.append(_mesh_trace(*shapes.plume_surface(plume), f"plume {plume.id}", color, 0.28))
    ball = shapes.ellipsoid_surface(plume.source, plume.source_covariance, N_SIGMA)
    traces.append(_mesh_trace(*ball, f"source {plume.id}, {N_SIGMA:.0f} sigma", color, 0.55))
    axis = plume.points_on_axis(np.array([0.0, plume.extent_high]))
    traces.append(
        _line_trace(axis, name="", color=color, width=4)
        | {"showlegend": False, "hoverinfo": "skip"}
    )
    return [trace | group for trace in traces]


def _scatter_trace(points: FloatArray, *, name: str, size: float, color: str) -> Trace:
    marker = {"size": size, "color": color, "line": {"width": 0}}
    return _xyz_arrays(points) | {
        "type": "scatter3d",
        "mode": "markers",
        "name": name,
        "marker": marker,
    }


def _line_trace(points: FloatArray, *, name: str, color: str, width: float) -> Trace:
    line = {"color": color, "width": width}
    return _xyz_arrays(points) | {"type": "scatter3d", "mode": "lines", "name": name, "line": line}


def _mesh_trace(
    vertices: FloatArray, triangles: NDArray[np.int64], name: str, color: str, opacity: float
) -> Trace:
    corners = {key: _typed_array(triangles[:, k]) for k, key in enumerate("ijk")}
    return _xyz_arrays(vertices) | {
        "type": "mesh3d",
        **corners,
        "name": name,
        "showlegend": True,
        "color": color,
        "opacity": opacity,
        "lighting": {"ambient": 0.75, "diffuse": 0.5, "specular": 0.1},
        "hoverinfo": "name",
    }


def _xyz_arrays(points: FloatArray) -> Trace:
    return {key: _typed_array(points[:, k]) for k, key in enumerate("xyz")}


def _typed_array(values: NDArray[Any]) -> dict[str, str]:
    """A typed array as plotly.js reads it."""
    kind = "i4" if values.dtype.kind == "i" else "f4"
    data = np.ascontiguousarray(values, dtype=f"<{kind}").tobytes()
    return {"dtype": kind, "bdata": b64encode(data).decode()}
