"""The overlay video: every frame of a run in colour, with its evidence and the plumes found."""

from collections.abc import Iterable, Mapping
from pathlib import Path

import cv2
import numpy as np

from geometry.arrays import FloatMap, Picture
from geometry.trajectory import Trajectory
from locate.export.pictures import add_label, overlay_evidence
from locate.export.report.layout import PLUME_COLORS
from locate.export.report.pictures import full_scale_nats
from locate.export.report.shapes import plume_surface
from locate.map.plume import Plume, PlumeMap
from locate.pipeline.shown import frame_label, source_px
from locate.recording import KeyFrames
from locate.recording.frame_files import PHOTOS_FPS
from locate.recording.posed_frames import PosedFrames
from locate.recording.writer import create_video

SHORT_S = 60.0
"""Length of a recording up to which the video is written without being asked for; chosen."""
MOST_WIDTH = 960
"""Of the video, px."""
FASTEST_FPS = 30.0
"""Frames per second of the video at most."""
FARTHEST_PX = 1e5
"""From the image; what lies farther out is not drawn, as OpenCV's coordinates are bounded."""
CODING = {"crf": "27", "preset": "veryfast", "rc-lookahead": "0"}
"""About 1 MB for 100 frames; looking ahead, x264 reads memory that it never wrote."""


def wants_overlay(asked: bool | None, key_frames: KeyFrames) -> bool:
    """Whether the video is written: as asked, else where the recording is short."""
    if asked is not None:
        return asked
    length_s = key_frames.times_s[-1] - key_frames.times_s[0]
    return not key_frames.is_video or float(length_s) <= SHORT_S


def write_overlay(
    path: Path,
    pictures: Iterable[tuple[int, Picture]],
    *,
    posed: PosedFrames,
    key_frames: KeyFrames,
    evidence: Mapping[int, FloatMap],
    plume_map: PlumeMap,
) -> None:
    """Writes overlay.mp4: where a frame was measured its evidence, and the plumes in all of them.

    Args:
        path: The file.
        pictures: Row and (H, W, 3) of each frame of the run, in order.
        posed: The frames of the run.
        key_frames: All that is known of them.
        evidence: (H, W) llr of the frames that were measured, by row.
        plume_map: The answer.
    """
    trajectory = posed.undistorted_trajectory()
    scale = min(1.0, MOST_WIDTH / posed.camera.width)
    size = (round(scale * posed.camera.width), round(scale * posed.camera.height))
    most_nats = full_scale_nats(list(evidence.values()))
    fps = _frames_per_second(posed, key_frames)
    with create_video(path, size=size, fps=fps, options=CODING) as video:
        for row, filmed in pictures:
            picture, label = filmed, frame_label(key_frames, int(posed.indices[row]))
            if row in evidence:
                picture = overlay_evidence(picture, evidence[row], most_nats)
            else:
                label += ", not measured"
            picture = picture.copy()
            if trajectory is not None:
                _draw_outlines(picture, plume_map.plumes, trajectory, row)
            _draw_sources(picture, posed, row, plume_map)
            small = cv2.resize(picture, size, interpolation=cv2.INTER_AREA)
            video.write(add_label(np.asarray(small, dtype=np.uint8), label))


def _frames_per_second(posed: PosedFrames, key_frames: KeyFrames) -> float:
    if not key_frames.is_video:
        return PHOTOS_FPS
    times_s = key_frames.times_of(posed.indices)
    spacing_s = float(np.median(np.diff(times_s))) if len(times_s) > 1 else 1.0
    return float(np.clip(1 / max(spacing_s, 1e-3), PHOTOS_FPS, FASTEST_FPS))


def _draw_outlines(
    picture: Picture, plumes: Iterable[Plume], trajectory: Trajectory, row: int
) -> None:
    """The outlines of the plumes' surfaces, of those that are before the camera as a whole."""
    for plume in plumes:
        pixels = trajectory.project(row, plume_surface(plume)[0])
        if len(pixels) < 3 or not np.isfinite(pixels).all() or np.abs(pixels).max() > FARTHEST_PX:
            continue
        outline = cv2.convexHull(np.rint(pixels).astype(np.int32))
        cv2.polylines(picture, [outline], True, _plume_bgr(plume.id), _stroke(picture), cv2.LINE_AA)


def _draw_sources(picture: Picture, posed: PosedFrames, row: int, plume_map: PlumeMap) -> None:
    places = source_px(posed, row, plume_map)
    for number, (x, y) in enumerate([] if places is None else places, start=1):
        if np.isfinite([x, y]).all() and max(abs(x), abs(y)) < FARTHEST_PX:
            center, radius = (round(float(x)), round(float(y))), picture.shape[1] // 60
            cv2.circle(picture, center, radius, _plume_bgr(number), _stroke(picture), cv2.LINE_AA)


def _plume_bgr(number: int) -> tuple[int, int, int]:
    """The colour that the report gives this plume."""
    red, green, blue = bytes.fromhex(PLUME_COLORS[(number - 1) % len(PLUME_COLORS)][1:])
    return blue, green, red


def _stroke(picture: Picture) -> int:
    return max(2, int(picture.shape[1]) // 320)
