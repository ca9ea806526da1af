"""The stage that shows: the map as files for other programs and as a report for people."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from geometry.arrays import FloatArray
from geometry.grid import Box
from geometry.npz import read_npz
from locate import __version__
from locate.export.geojson import write_geojson
from locate.export.geopackage import write_geopackage
from locate.export.kml import write_kml
from locate.export.ply import write_plumes_ply
from locate.export.report import ReportFrame, write_report
from locate.export.waypoints import write_cup, write_gpx
from locate.journal.costs import StageTime
from locate.map.plume import Plume, PlumeMap
from locate.pipeline.observe import Recorded, load_detections, load_points

GEOREFERENCED = {
    "plumes.geojson": write_geojson,
    "plumes.kml": write_kml,
    "plumes.gpkg": write_geopackage,
    "plumes.gpx": write_gpx,
    "plumes.cup": write_cup,
}
SHOWN_FRAMES = 8
REACH_RADII = 1.5


def publish(
    root: Path,
    folder: Path,
    recorded: Recorded,
    *,
    stages: Sequence[StageTime],
    settings: Mapping[str, Any],
) -> str:
    """Writes plumes.ply, report.html, and where the map is georeferenced what GIS and pilots read.

    Args:
        root: The run folder with its earlier stages.
        folder: Where to write.
        recorded: The frames of the run.
        stages: What they cost.
        settings: What the run was told.
    """
    plume_map = PlumeMap.load(root / "map.json")
    voxels = plume_voxels(root / "evidence.npz", plume_map)
    write_plumes_ply(
        folder / "plumes.ply",
        points_in_world=voxels[:, :3],
        probability=voxels[:, 3],
        displacement_px=voxels[:, 4],
    )
    if plume_map.georeference is not None:
        for name, write in GEOREFERENCED.items():
            write(folder / name, plume_map)
    points = load_points(root / "points.npz")
    write_report(
        folder / "report.html",
        plume_map=plume_map,
        trajectory=recorded.trajectory,
        points_in_world=np.zeros((0, 3)) if points is None else points,
        voxels_in_world=voxels[:, :3],
        voxel_probability=voxels[:, 3],
        frames=_report_frames(root, recorded, plume_map),
        stages=stages,
        settings={name: str(value) for name, value in settings.items() if value is not None}
        | {"version": __version__},
    )
    return "report.html, plumes.ply"


def plume_voxels(evidence: Path, plume_map: PlumeMap) -> FloatArray:
    """(N, 5) of the voxels within the plumes: x, y, z, probability, displacement in px.

    The probability is the logistic of a voxel's mean evidence per view.
    """
    if not evidence.exists() or not plume_map.plumes:
        return np.zeros((0, 5))
    file = read_npz(evidence)
    llr, weight = file["llr"].astype(float), file["weight"].astype(float)
    nz, ny, nx = llr.shape
    box = Box(low_in_world=file["low_in_world"], voxel=float(file["voxel"]), shape=(nz, ny, nx))
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


def _report_frames(root: Path, recorded: Recorded, plume_map: PlumeMap) -> list[ReportFrame]:
    _, indices, detections = load_detections(root / "detections")
    rows = recorded.rows(indices)
    frames = recorded.frames()
    return [
        ReportFrame(
            index=indices[k],
            image=frames.images[int(rows[k])],
            llr=detections[k].llr,
            source_px=_source_px(recorded, int(rows[k]), plume_map),
        )
        for k in np.unique(np.linspace(0, len(indices) - 1, SHOWN_FRAMES).astype(int))
    ]


def _source_px(recorded: Recorded, row: int, plume_map: PlumeMap) -> FloatArray | None:
    """(K, 2) where the sources, or the bearings of a camera at rest, are in a frame."""
    trajectory = recorded.undistorted_trajectory()
    if trajectory is None and plume_map.bearings:
        directions = np.array([bearing.direction_in_cam for bearing in plume_map.bearings])
        return recorded.camera.undistorted().project(directions)
    if trajectory is not None and plume_map.plumes:
        return trajectory.project(row, np.array([plume.source for plume in plume_map.plumes]))
    return None
