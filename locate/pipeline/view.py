"""A finished run as a recording of the viewer."""

from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path

import cv2
import numpy as np

from detect.detection import Detection
from geometry.arrays import Picture
from geometry.errors import BadInputError
from geometry.named_paths import resolve_path
from locate.export.report.pictures import full_scale_nats
from locate.export.viewing import ViewedFrame, ViewedRun, require_rerun, write_rrd
from locate.map.plume import PlumeMap
from locate.pipeline.config import RunConfig, read_settings
from locate.pipeline.detections import load_detections
from locate.pipeline.files import RunFiles
from locate.pipeline.points import load_points
from locate.pipeline.poses import frames_at_rest, frames_with_poses
from locate.pipeline.publish import plume_voxels
from locate.pipeline.source import RecordingSource
from locate.recording import KeyFrames
from locate.recording.colours import undistorted_pictures
from locate.recording.posed_frames import PosedFrames

FULL_SCALE_PERCENTILE = 99.5
"""Of the displacement where there is evidence, drawn in full colour; chosen by hand."""


def write_view(output: Path, path: Path) -> None:
    """Writes a finished run as a recording that the viewer Rerun opens.

    Args:
        output: The run folder.
        path: The file to write, ending in ``.rrd``.

    Raises:
        BadInputError: The folder is not of a finished run, or lacks its frames or detections; the
            extra ``view`` is not installed; or the file cannot be written.
    """
    require_rerun()
    files = RunFiles(output)
    plume_map = PlumeMap.load(files.map)
    for needed in (files.frames, files.detections):
        if not needed.exists():
            raise BadInputError(f"{needed}: is gone; repeat the run, then view it")
    key_frames = KeyFrames.load(files.frame_index)
    posed = _posed_frames(files, key_frames)
    _, indices, found = load_detections(files.detections)
    points = load_points(files.points)
    run = ViewedRun(
        name=resolve_path(output).name,
        plume_map=plume_map,
        camera=posed.camera.undistorted(),
        trajectory=posed.undistorted_trajectory(),
        points_in_world=np.zeros((0, 3)) if points is None else points,
        voxels=plume_voxels(files.evidence, plume_map),
        full_scale_nats=full_scale_nats([detection.llr for detection in found]),
        full_scale_px=_full_scale_px(found),
    )
    pictures = _pictures(files, posed, key_frames)
    measured = dict(zip(indices, found, strict=True))
    write_rrd(path, run, _frames(posed, key_frames, pictures, measured))


def _posed_frames(files: RunFiles, key_frames: KeyFrames) -> PosedFrames:
    if files.trajectory.exists():
        return frames_with_poses(files, key_frames)
    return frames_at_rest(_source(files), key_frames, files.frames)


def _source(files: RunFiles) -> RecordingSource:
    return RecordingSource.of(RunConfig.of(read_settings(files.config)))


def _pictures(files: RunFiles, posed: PosedFrames, key_frames: KeyFrames) -> Iterator[Picture]:
    """The frames in colour, or grey as the run kept them where its recording is gone."""
    try:
        recording = _source(files).open_frames()
    except BadInputError:
        for grey in posed.undistorted().images:
            yield np.asarray(cv2.cvtColor(grey, cv2.COLOR_GRAY2BGR), dtype=np.uint8)
        return
    rows, times_s = range(len(posed.indices)), key_frames.times_of(posed.indices)
    for _, picture in undistorted_pictures(recording, posed, rows, times_s):
        yield picture


def _full_scale_px(found: list[Detection]) -> float:
    sizes = [
        np.linalg.norm(detection.displacement[detection.llr > 0], axis=-1) for detection in found
    ]
    seen = np.concatenate([np.zeros(0), *sizes])
    return float(np.percentile(seen, FULL_SCALE_PERCENTILE)) if len(seen) else 1.0


def _frames(
    posed: PosedFrames,
    key_frames: KeyFrames,
    pictures: Iterable[Picture],
    found: Mapping[int, Detection],
) -> Iterator[ViewedFrame]:
    times = dict(zip(key_frames.indices.tolist(), key_frames.times_s.tolist(), strict=True))
    for index, picture in zip(posed.indices.tolist(), pictures, strict=True):
        yield ViewedFrame(
            index=index,
            time_s=times[index] if key_frames.is_video else None,
            picture=picture,
            detection=found.get(index),
        )
