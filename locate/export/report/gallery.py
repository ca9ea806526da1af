"""The frames of the report: as filmed, with the evidence, and with the displacement beside it."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from html import escape
from string import Template

import numpy as np

from geometry.arrays import FloatArray, FloatMap, Picture
from geometry.threads import map_by_threads
from locate.export.html import read_resource
from locate.export.report import pictures
from locate.map.plume import PlumeMap


@dataclass(frozen=True, kw_only=True)
class ReportFrame:
    """A frame to show.

    Attributes:
        index: Index in the recording.
        label: Its time, or the name of its photo.
        picture: (H, W, 3) blue, green, red.
        llr: (H, W) evidence in nats, of any size with the same aspect.
        displacement: (h, w, 2) px, likewise; None where there is none to show.
        source_px: (K, 2) where sources or bearings project to; None for no mark.
    """

    index: int
    label: str
    picture: Picture
    llr: FloatMap
    displacement: FloatMap | None = None
    source_px: FloatArray | None = None


def frame_gallery(
    frames: Sequence[ReportFrame], plume_map: PlumeMap, video: str | None, jobs: int = 1
) -> str:
    """HTML of all frames, with what chooses among them and a larger view of each.

    Args:
        frames: In order.
        plume_map: Whose plumes they saw.
        video: Name of the overlay video beside the page; None where there is none.
        jobs: Threads that code the pictures.
    """
    if not frames:
        return "<p>No frames were kept for this page.</p>"
    displacements = [one.displacement for one in frames if one.displacement is not None]
    most_nats = pictures.full_scale_nats([frame.llr for frame in frames])
    most_px = pictures.full_scale_px(displacements)
    figure = partial(_frame_figure, plume_map=plume_map, most_nats=most_nats, most_px=most_px)
    return Template(read_resource("report/frames.html")).substitute(
        gradient=", ".join(pictures.heat_stops()),
        most_nats=f"{most_nats:g}",
        most_px=f"{most_px:g}",
        unmeasured="" if displacements else "hidden",
        choices=_plume_choices(frames, plume_map),
        figures="".join(map_by_threads(jobs, figure, frames)),
        video="" if video is None else _video_link(video),
    )


def _plume_choices(frames: Sequence[ReportFrame], plume_map: PlumeMap) -> str:
    """Buttons that choose the frames that saw a plume."""
    if not plume_map.plumes:
        return ""
    choices = [("", f"All {len(frames)} frames")]
    for plume in plume_map.plumes:
        count = sum(frame.index in plume.views for frame in frames)
        choices.append((str(plume.id), f"{count} saw plume {plume.id}"))
    return "".join(
        f'<button type="button" data-plume="{number}" aria-pressed="{str(not number).lower()}">'
        f"{text}</button>"
        for number, text in choices
    )


def _video_link(video: str) -> str:
    return (
        f'<p class="hint">All frames in a row: <a href="{escape(video)}">{escape(video)}</a>, '
        "beside this page.</p>"
    )


def _frame_figure(frame: ReportFrame, plume_map: PlumeMap, most_nats: float, most_px: float) -> str:
    seen = [str(plume.id) for plume in plume_map.plumes if frame.index in plume.views]
    caption = frame.label + (f", saw plume {' and '.join(seen)}" if seen else "")
    height, width = frame.picture.shape[:2]
    displacement = ""
    if frame.displacement is not None:
        uri = pictures.displacement_uri(frame.displacement, most_px)
        displacement = (
            f'<span class="stack displacement"><img src="{uri}" '
            f'alt="{escape(frame.label)}, displacement"></span>'
        )
    return Template(read_resource("report/frame.html")).substitute(
        index=frame.index,
        plumes=" ".join(seen),
        caption=escape(caption),
        width=width,
        height=height,
        picture=pictures.frame_uri(frame.picture),
        evidence=pictures.evidence_uri(frame.llr, most_nats),
        marks="" if frame.source_px is None else _source_marks(frame.source_px, width),
        displacement=displacement,
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
