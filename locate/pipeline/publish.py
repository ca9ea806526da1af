"""The stage that shows: the map as files for other programs and as a report for people."""

from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from geometry.arrays import FloatArray
from geometry.grid import VoxelBox
from geometry.npz import read_npz
from locate import __version__
from locate.export.geojson import write_geojson
from locate.export.geopackage import write_geopackage
from locate.export.html import resource_path
from locate.export.kml import write_kml
from locate.export.ply import write_plumes_ply, write_scene_ply
from locate.export.report import write_report
from locate.export.waypoints import write_cup, write_gpx
from locate.journal.costs import StageTime
from locate.map.plume import Plume, PlumeMap
from locate.pipeline.config import RunConfig
from locate.pipeline.detections import load_detections
from locate.pipeline.files import RunFiles
from locate.pipeline.fingerprint import fingerprint_path
from locate.pipeline.overlay import wants_overlay, write_overlay
from locate.pipeline.points import load_points
from locate.pipeline.shown import coloured_points, report_frame, spread
from locate.pipeline.source import RecordingSource
from locate.recording import KeyFrames
from locate.recording.colours import undistorted_pictures
from locate.recording.posed_frames import PosedFrames
from locate.robot.bag_results import write_map_bag

GEOREFERENCED = {
    "plumes.geojson": write_geojson,
    "plumes.kml": write_kml,
    "plumes.gpkg": write_geopackage,
    "plumes.gpx": write_gpx,
    "plumes.cup": write_cup,
}
PAGE_PARTS = ("page", "report")
"""Folders of the package's data that the report is made of."""
REACH_RADII = 1.5
"""Distance from the axis, in radii of the plume, up to which voxels are its own."""


def publish(
    source: RecordingSource,
    key_frames: KeyFrames,
    posed: PosedFrames,
    *,
    files: RunFiles,
    target: RunFiles,
    stages: Sequence[StageTime],
    jobs: int = 1,
) -> str:
    """Writes the plumes for other programs and the report for people; returns a summary.

    Args:
        source: Where the frames come from.
        key_frames: The frames of the run.
        posed: Those of them that are used.
        files: The run folder with its earlier stages.
        target: Where to write.
        stages: What the stages cost.
        jobs: Threads that code the pictures of the report.
    """
    plume_map = PlumeMap.load(files.map)
    voxels = plume_voxels(files.evidence, plume_map)
    _write_plumes(plume_map, voxels, target)
    _, indices, detections = load_detections(files.detections)
    measured = dict(zip(posed.rows_of(indices).tolist(), detections, strict=True))
    recording = source.open_frames()
    times_s = key_frames.times_of(posed.indices)
    if wants_overlay(source.config.overlay, key_frames):
        write_overlay(
            target.overlay,
            undistorted_pictures(recording, posed, range(len(posed.indices)), times_s),
            posed=posed,
            key_frames=key_frames,
            evidence={row: detection.llr for row, detection in measured.items()},
            plume_map=plume_map,
        )
    pictures = dict(undistorted_pictures(recording, posed, spread(list(measured)), times_s))
    points = coloured_points(load_points(files.points), posed, pictures)
    if posed.trajectory is not None:
        write_scene_ply(
            target.scene_points,
            points_in_world=points.in_world,
            colours=points.colours,
            voxels_in_world=voxels[:, :3],
            voxel_probability=voxels[:, 3],
        )
    write_report(
        target.report,
        plume_map=plume_map,
        trajectory=posed.trajectory,
        points=points,
        voxels_in_world=voxels[:, :3],
        voxel_probability=voxels[:, 3],
        frames=[
            report_frame(
                picture,
                measured[row],
                posed=posed,
                row=row,
                key_frames=key_frames,
                plume_map=plume_map,
            )
            for row, picture in pictures.items()
        ],
        video=target.overlay.name if target.overlay.exists() else None,
        stages=stages,
        settings=_stated_settings(source.config),
        jobs=jobs,
    )
    written = f"{target.report.name}, {target.plume_points.name}"
    if source.config.poses is None and _write_bag(source, key_frames, plume_map, target.plume_bag):
        written += ", plumes.mcap"
    return written


def _write_plumes(plume_map: PlumeMap, voxels: FloatArray, target: RunFiles) -> None:
    """Writes the plumes as points, and for maps of the Earth where their place there is known."""
    write_plumes_ply(
        target.plume_points,
        points_in_world=voxels[:, :3],
        probability=voxels[:, 3],
        displacement_px=voxels[:, 4],
    )
    if plume_map.georeference is not None:
        for name, write in GEOREFERENCED.items():
            write(target.root / name, plume_map)


def _stated_settings(config: RunConfig) -> dict[str, str]:
    """The settings that the report lists."""
    settings = config.to_plain() | asdict(config.amounts) | {"version": __version__}
    return {name: str(value) for name, value in settings.items() if value is not None}


def publish_inputs(config: RunConfig) -> dict[str, Any]:
    """What the report depends on beside the map."""
    pages = [fingerprint_path(resource_path(part)) for part in PAGE_PARTS]
    return {"pages": pages, "overlay": config.overlay}


def _write_bag(
    source: RecordingSource, key_frames: KeyFrames, plume_map: PlumeMap, folder: Path
) -> bool:
    """Writes the plumes as a bag, in the world of the recording's poses, where it is one."""
    bag = source.bag
    if bag is None or not bag.has_poses:
        return False
    last = int(key_frames.frames[-1].source)
    write_map_bag(folder, plume_map, frame_id=bag.wiring.world_frame, stamp_ns=last)
    return True


def plume_voxels(evidence: Path, plume_map: PlumeMap) -> FloatArray:
    """(N, 5) of the voxels within the plumes: x, y, z, probability, displacement in px.

    The probability is the logistic of a voxel's mean evidence per view.
    """
    if not evidence.exists() or not plume_map.plumes:
        return np.zeros((0, 5))
    file = read_npz(evidence)
    llr, weight = file["llr"].astype(float), file["weight"].astype(float)
    nz, ny, nx = llr.shape
    box = VoxelBox(
        low_in_world=file["low_in_world"], voxel=float(file["voxel"]), shape=(nz, ny, nx)
    )
    seen = np.argwhere((llr > 0) & (weight > 0))
    points = box.centers_in_world(seen.astype(float))
    mean = llr[tuple(seen.T)] / weight[tuple(seen.T)]
    rows = []
    for plume in plume_map.plumes:
        inside = _inside(plume, points, box.voxel)
        share = 1 / (1 + np.exp(-mean[inside]))
        size = np.full(len(share), plume.displacement_px)
        rows.append(np.column_stack([points[inside], share, size]))
    return np.concatenate(rows)


def _inside(plume: Plume, points: FloatArray, voxel: float) -> np.ndarray:
    along = (points - plume.source) @ plume.axis
    across = np.linalg.norm(points - plume.source - along[:, None] * plume.axis, axis=1)
    radius = np.interp(along, *plume.radius_by_height.T)
    within = (along >= plume.extent_low) & (along <= plume.extent_high)
    return np.asarray(within & (across <= REACH_RADII * radius + voxel / 2))
