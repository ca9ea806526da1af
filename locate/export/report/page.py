"""The page of the report: fragments of HTML put into one template."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from html import escape
from pathlib import Path
from string import Template
from typing import Any

import numpy as np

from geometry.arrays import FloatArray, FloatMap, GreyImage
from geometry.trajectory import Trajectory
from locate.export.html import definition_rows, html_table, list_items, read_resource, write_page
from locate.export.report import pictures, scene, words
from locate.export.table import answer_rows
from locate.journal.costs import StageTime
from locate.map.plume import PlumeMap


@dataclass(frozen=True, kw_only=True)
class ReportFrame:
    """A frame to show.

    Attributes:
        index: Index in the video.
        image: (H, W) uint8.
        llr: (H, W) evidence in nats, of any size with the same aspect.
        source_px: (K, 2) where sources or bearings project to; None for no mark.
    """

    index: int
    image: GreyImage
    llr: FloatMap
    source_px: FloatArray | None = None


def write_report(
    path: Path,
    *,
    plume_map: PlumeMap,
    trajectory: Trajectory | None,
    points_in_world: FloatArray,
    voxels_in_world: FloatArray,
    voxel_probability: FloatArray,
    frames: Sequence[ReportFrame],
    stages: Sequence[StageTime],
    settings: Mapping[str, str],
    notes: Sequence[str] = (),
) -> None:
    """Writes report.html, one file of about 5 MB that needs no network.

    Args:
        path: The file.
        plume_map: The answer.
        trajectory: The cameras; None where the camera stood still, then there is no 3D scene.
        points_in_world: (N, 3) sparse points of the scene; N may be 0.
        voxels_in_world: (V, 3) voxels that hold evidence; V may be 0.
        voxel_probability: (V,) logistic of their mean evidence per view; 0.5 is no evidence.
        frames: Frames to show with their evidence.
        stages: Times of the run.
        settings: Settings and versions, as the reader should see them.
        notes: Sentences for the section on limits, beside the notes of the map itself.
    """
    spatial = None
    if trajectory is not None:
        spatial = scene.scene_figure(
            plume_map, trajectory, points_in_world, voxels_in_world, voxel_probability
        )
    fragments = {
        "scene": "" if spatial is None else read_resource("report/scene.html"),
        "advice": _advice(plume_map),
        "pictures": _frame_gallery(frames, plume_map),
        "table": _answer_table(plume_map),
        "limits": list_items([*words.limits(plume_map, trajectory), *notes]),
        "stages": _stage_table(stages),
        "settings": definition_rows(settings.items()),
    }
    write_page(
        path,
        "report",
        kind="Plume map",
        headline=words.headline(plume_map),
        lead=words.lead(plume_map),
        facts=words.facts(plume_map, trajectory),
        fragments=fragments,
        scripts=() if spatial is None else _page_scripts(),
        data={} if spatial is None else {"figure": _to_json(spatial)},
    )


def _advice(plume_map: PlumeMap) -> str:
    if not plume_map.obstacles:
        return ""
    remedies = list_items(obstacle.remedy for obstacle in plume_map.obstacles)
    return Template(read_resource("report/advice.html")).substitute(remedies=remedies)


def _to_json(spatial: dict[str, Any]) -> str:
    return json.dumps(spatial, separators=(",", ":"), allow_nan=False)


def _page_scripts() -> list[str]:
    from plotly.offline import get_plotlyjs

    return [get_plotlyjs(), read_resource("report/scene.js")]


def _answer_table(plume_map: PlumeMap) -> str:
    columns = [*answer_rows(plume_map)]
    if not columns:
        return f"<p>{escape(plume_map.limit_text())}</p>"
    labels = dict.fromkeys((row[0], row[2]) for _, rows in columns for row in rows)
    values = [{(what, unit): value for what, value, unit in rows} for _, rows in columns]
    rows = [
        [what, *(column.get((what, unit), "") for column in values), unit] for what, unit in labels
    ]
    return html_table(["Quantity", *(name for name, _ in columns), "Unit"], rows, named_rows=True)


def _stage_table(stages: Sequence[StageTime]) -> str:
    longest = max((stage.wall_s for stage in stages), default=0.0) or 1.0
    rows = "".join(
        f'<tr><th scope="row">{escape(stage.name)}</th>'
        f'<td class="bar" style="--share:{stage.wall_s / longest:.3f}">{stage.wall_s:.1f}</td>'
        f"<td>{stage.cpu_s:.1f}</td><td>{escape(stage.note)}</td></tr>"
        for stage in stages
    )
    wall, cpu = sum(s.wall_s for s in stages), sum(s.cpu_s for s in stages)
    return (
        f"<tbody>{rows}</tbody><tfoot><tr><th scope='row'>whole run</th>"
        f"<td>{wall:.1f}</td><td>{cpu:.1f}</td><td></td></tr></tfoot>"
    )


def _frame_gallery(frames: Sequence[ReportFrame], plume_map: PlumeMap) -> str:
    scale = pictures.full_scale_nats([frame.llr for frame in frames])
    gradient = ", ".join(pictures.heat_stops())
    shown = "".join(_frame_figure(frame, scale, plume_map) for frame in frames)
    if not shown:
        return "<p>No frames were kept for this page.</p>"
    return (
        '<label class="toggle"><input type="checkbox" checked> Show the evidence</label>'
        f'<p class="scale"><span>0</span><i style="background:linear-gradient(90deg, {gradient})">'
        f"</i><span>{scale:g} nats and more</span></p>"
        f'<div class="frames">{shown}</div>'
    )


def _frame_figure(frame: ReportFrame, scale: float, plume_map: PlumeMap) -> str:
    size = pictures.fitted_size(frame.image)
    seen = [str(plume.id) for plume in plume_map.plumes if frame.index in plume.views]
    caption = f"Frame {frame.index}" + (f", sees plume {', '.join(seen)}" if seen else "")
    height, width = frame.image.shape
    marks = "" if frame.source_px is None else _source_marks(frame.source_px, width)
    return (
        f'<figure><div class="stack" style="aspect-ratio:{width}/{height}">'
        f'<img src="{pictures.frame_uri(frame.image)}" alt="{escape(caption)}, as filmed">'
        f'<img class="evidence" src="{pictures.evidence_uri(frame.llr, size, scale)}" alt="">'
        f'<svg viewBox="-0.5 -0.5 {width} {height}" aria-hidden="true">{marks}</svg></div>'
        f"<figcaption>{escape(caption)}</figcaption></figure>"
    )


def _source_marks(source_px: FloatArray, width: int) -> str:
    radius = width / 60
    points = source_px.reshape(-1, 2)
    visible = points[np.isfinite(points).all(axis=1)]
    return "".join(
        f'<circle cx="{x:.1f}" cy="{y:.1f}" r="{radius:.1f}"/>'
        f'<path d="M{x - 2 * radius:.1f} {y:.1f}h{radius:.1f}M{x + radius:.1f} {y:.1f}'
        f'h{radius:.1f}"/>'
        for x, y in visible
    )
