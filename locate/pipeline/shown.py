"""What a run shows of its frames: in colour, with what was measured in them."""

from collections.abc import Mapping, Sequence

import numpy as np

from detect.detection import Detection
from geometry.arrays import FloatArray, FloatMap, Picture
from locate.export.report import ColouredPoints, ReportFrame
from locate.map.plume import PlumeMap
from locate.recording import KeyFrames
from locate.recording.posed_frames import PosedFrames

MOST_SHOWN = 24
"""Frames of the report; bounds the size of the file."""
SMOOTHING_CELLS = 2.0
"""Standard deviation over which a displacement is averaged to be looked at; chosen by hand."""


def spread(rows: Sequence[int]) -> list[int]:
    """At most `MOST_SHOWN` of the measured frames, evenly."""
    chosen = np.linspace(0, len(rows) - 1, min(len(rows), MOST_SHOWN)).round()
    return [rows[int(k)] for k in chosen]


def report_frame(
    picture: Picture,
    detection: Detection,
    *,
    posed: PosedFrames,
    row: int,
    key_frames: KeyFrames,
    plume_map: PlumeMap,
) -> ReportFrame:
    """A measured frame as the report shows it.

    Args:
        picture: (H, W, 3).
        detection: What was measured in it.
        posed: The frames of the run.
        row: Which of them it is.
        key_frames: All that is known of them.
        plume_map: The answer.
    """
    index = int(posed.indices[row])
    return ReportFrame(
        index=index,
        label=frame_label(key_frames, index),
        picture=picture,
        llr=detection.llr,
        displacement=visible_displacement(detection),
        source_px=source_px(posed, row, plume_map),
    )


def frame_label(key_frames: KeyFrames, index: int) -> str:
    """When a frame of a video was taken, or the name of its photo."""
    frame = key_frames.frames[int(np.searchsorted(key_frames.indices, index))]
    return f"{frame.time_s:.2f} s, frame {index}" if key_frames.is_video else frame.source


def visible_displacement(detection: Detection) -> FloatMap:
    """(h, w, 2) px, smooth enough to be seen; 0 where nothing was measured."""
    if detection.information is not None:
        return detection.information.local_mean(SMOOTHING_CELLS)
    measured = np.isfinite(detection.sigma_px)[..., None]
    return np.where(measured, detection.displacement, 0).astype(np.float32)


def source_px(posed: PosedFrames, row: int, plume_map: PlumeMap) -> FloatArray | None:
    """(K, 2) where the sources, or the bearings of a camera at rest, are in a frame."""
    trajectory = posed.undistorted_trajectory()
    if trajectory is None and plume_map.bearings:
        directions = np.array([bearing.direction_in_cam for bearing in plume_map.bearings])
        return posed.camera.undistorted().project(directions)
    if trajectory is not None and plume_map.plumes:
        return trajectory.project(row, np.array([plume.source for plume in plume_map.plumes]))
    return None


def coloured_points(
    points_in_world: FloatArray | None, posed: PosedFrames, pictures: Mapping[int, Picture]
) -> ColouredPoints:
    """Points of the scene in the median of the colours at which some frames show them.

    Args:
        points_in_world: (N, 3), or None.
        posed: The frames of the run.
        pictures: Some of them by row.
    """
    if points_in_world is None or not len(points_in_world):
        return ColouredPoints.grey(np.zeros((0, 3)))
    grey = ColouredPoints.grey(points_in_world)
    trajectory = posed.undistorted_trajectory()
    if trajectory is None or not pictures:
        return grey
    seen = np.full((len(pictures), len(points_in_world), 3), np.nan, dtype=np.float32)
    for samples, (row, picture) in zip(seen, pictures.items(), strict=True):
        pixels = trajectory.project(row, points_in_world)
        size = np.array(picture.shape[1::-1])
        inside = ((pixels > -0.5) & (pixels < size - 0.5)).all(axis=1)
        columns, lines = np.rint(pixels[inside]).astype(int).T
        samples[inside] = picture[lines, columns, ::-1]
    known = np.isfinite(seen[..., 0]).any(axis=0)
    colours = grey.colours.copy()
    colours[known] = np.nanmedian(seen[:, known], axis=0).round()
    return ColouredPoints(points_in_world, colours)
