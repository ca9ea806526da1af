"""The page of the report: fragments of HTML put into one template."""

import json
from collections.abc import Mapping, Sequence
from html import escape
from pathlib import Path
from string import Template
from typing import Any

from geometry.arrays import FloatArray
from geometry.trajectory import Trajectory
from locate.export.html import definition_rows, html_table, list_items, read_resource, write_page
from locate.export.report import scene, words
from locate.export.report.earth import earth_section
from locate.export.report.gallery import ReportFrame, frame_gallery
from locate.export.report.pictures import heat_stops
from locate.export.report.scene import ColouredPoints
from locate.export.table import answer_rows
from locate.journal.costs import StageTime
from locate.map.plume import PlumeMap

PLUMES_HINT = (
    " A click on a plume chooses the frames that saw it. The ellipsoid around a source is drawn at "
    "2 sigma: it holds the true source 74 times out of 100 if the covariance is right."
)


def write_report(
    path: Path,
    *,
    plume_map: PlumeMap,
    trajectory: Trajectory | None,
    points: ColouredPoints,
    voxels_in_world: FloatArray,
    voxel_probability: FloatArray,
    frames: Sequence[ReportFrame],
    stages: Sequence[StageTime],
    settings: Mapping[str, str],
    notes: Sequence[str] = (),
    video: str | None = None,
    jobs: int = 1,
) -> None:
    """Writes report.html, one file of 5 to 10 MB that needs no network.

    Args:
        path: The file.
        plume_map: The answer.
        trajectory: The cameras; None where the camera stood still, then there is no 3D scene.
        points: Sparse points of the scene; there may be none.
        voxels_in_world: (V, 3) voxels that hold evidence; V may be 0.
        voxel_probability: (V,) logistic of their mean evidence per view; 0.5 is no evidence.
        frames: Frames to show with their evidence.
        stages: Times of the run.
        settings: Settings and versions, as the reader should see them.
        notes: Sentences for the section on limits, beside the notes of the map itself.
        video: Name of the overlay video beside the page; None where there is none.
        jobs: Threads that code the pictures.
    """
    spatial = None
    if trajectory is not None:
        spatial = scene.scene_figure(
            plume_map,
            trajectory,
            points,
            voxels_in_world,
            voxel_probability,
            [frame.index for frame in frames],
        )
    fragments = {
        "scene": ""
        if spatial is None
        else _scene_section(spatial, evidence=len(voxels_in_world) > 0),
        "advice": _advice(plume_map),
        "pictures": frame_gallery(frames, plume_map, video, jobs),
        "table": _answer_table(plume_map),
        "earth": earth_section(plume_map, trajectory, points.in_world),
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
        scripts=_page_scripts(spatial=spatial is not None),
        data={} if spatial is None else {"figure": _to_json(spatial)},
    )


def _advice(plume_map: PlumeMap) -> str:
    if not plume_map.obstacles:
        return ""
    remedies = list_items(obstacle.remedy for obstacle in plume_map.obstacles)
    return Template(read_resource("report/advice.html")).substitute(remedies=remedies)


def _to_json(spatial: dict[str, Any]) -> str:
    return json.dumps(spatial, separators=(",", ":"), allow_nan=False)


def _page_scripts(*, spatial: bool) -> list[str]:
    frames = read_resource("report/frames.js")
    if not spatial:
        return [frames]
    from plotly.offline import get_plotlyjs

    return [frames, get_plotlyjs(), read_resource("report/scene.js")]


def _scene_section(spatial: dict[str, Any], *, evidence: bool) -> str:
    close_ups = "".join(
        f'<button type="button" aria-pressed="{str(not number).lower()}">{escape(name)}</button>'
        for number, name in enumerate(spatial["close_ups"])
    )
    scale = Template(read_resource("report/scene_scale.html"))
    gradient = ", ".join(heat_stops())
    return Template(read_resource("report/scene.html")).substitute(
        close_ups=close_ups,
        scale=scale.substitute(gradient=gradient) if evidence else "",
        plumes_hint=PLUMES_HINT if close_ups else "",
    )


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
