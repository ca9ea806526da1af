"""A run as a recording of Rerun, a viewer in space and time (extra ``view``)."""

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import cv2
import numpy as np
from scipy.spatial.transform import Rotation

from detect.detection import Detection
from geometry.arrays import FloatArray, GreyImage, Picture
from geometry.atomic import atomic_path
from geometry.camera import Camera
from geometry.errors import BadInputError
from geometry.trajectory import Trajectory
from locate.export.pictures import displacement_picture, evidence_layer, heat_rgb
from locate.export.rays import rays_of_evidence
from locate.export.report.layout import CAMERA_COLOR, PLUME_COLORS, POINT_COLOR
from locate.export.report.scene import N_SIGMA
from locate.export.report.shapes import plume_surface
from locate.export.table import probability_text
from locate.map.plume import Plume, PlumeMap

if TYPE_CHECKING:
    import rerun
    import rerun.blueprint

FRAME, TIME = "frame", "recording_time"
"""The clocks of the timeline: index in the recording, and s from its start."""
WORLD, CAMERA = "world", "world/camera"
"""Entities: space, and the camera in it, with its pictures below."""
FRUSTUM_SHARE = 0.15
"""Depth of the camera's pyramid, as a share of the median distance of the scene."""
FARTHEST = 2.0
"""Length of the longest ray, in the same distance."""
NOT_MEASURED = 128
"""Grey level of the displacement in frames without one."""
COLUMN_ALPHA = 70
"""Opacity of the surface of a plume, of 255."""


@dataclass(frozen=True, kw_only=True)
class ViewedFrame:
    """One frame of a run.

    Attributes:
        index: In the recording.
        time_s: From the start of the recording; None for photos.
        picture: (H, W, 3) blue, green, red, undistorted.
        detection: What was measured in it; None in frames that were not measured.
    """

    index: int
    time_s: float | None
    picture: Picture
    detection: Detection | None


@dataclass(frozen=True, kw_only=True)
class ViewedRun:
    """What does not change from frame to frame.

    Attributes:
        name: Of the run.
        plume_map: The answer.
        camera: The pinhole camera of the undistorted frames.
        trajectory: All poses of that camera; None where it was at rest, and the world is its own.
        points_in_world: (N, 3) sparse points; N may be 0.
        voxels: (V, 5) of the plumes: x, y, z, probability, displacement in px; V may be 0.
        full_scale_nats: Evidence that is drawn in full colour.
        full_scale_px: Displacement likewise.
    """

    name: str
    plume_map: PlumeMap
    camera: Camera
    trajectory: Trajectory | None
    points_in_world: FloatArray
    voxels: FloatArray
    full_scale_nats: float
    full_scale_px: float

    @property
    def scene_range(self) -> float:
        """Median distance of the scene from the cameras, world units."""
        if self.trajectory is None or len(self.points_in_world) == 0:
            return 1.0
        middle = self.trajectory.centers_in_world.mean(axis=0)
        return float(np.median(np.linalg.norm(self.points_in_world - middle, axis=1)))


def require_rerun() -> None:
    """Imports rerun.

    Raises:
        BadInputError: The extra is not installed.
    """
    try:
        import rerun.blueprint  # noqa: F401
    except ImportError as error:
        raise BadInputError("the viewer is an extra: pip install 'plume-locate[view]'") from error


def write_rrd(path: Path, run: ViewedRun, frames: Iterable[ViewedFrame]) -> None:
    """Writes a run as a recording that the viewer Rerun opens, whole or not at all.

    Args:
        path: The file, ending in ``.rrd``.
        run: What does not change from frame to frame.
        frames: In order; read one after the other.

    Raises:
        BadInputError: The extra is not installed, or the file cannot be written.
    """
    require_rerun()
    import rerun as rr

    if path.suffix != ".rrd":
        raise BadInputError(f"{path}: the viewer Rerun opens files whose names end in .rrd")
    stream = rr.RecordingStream("locate", send_properties=False)
    stream.set_log_time_enabled(False)
    stream.set_log_tick_enabled(False)
    with atomic_path(path) as unfinished:
        stream.save(unfinished, default_blueprint=_blueprint())
        stream.send_recording_name(run.name)
        _log_scene(stream, run)
        for plume in run.plume_map.plumes:
            _log_plume(stream, plume)
        for row, frame in enumerate(frames):
            stream.set_time(FRAME, sequence=frame.index)
            if frame.time_s is not None:
                stream.set_time(TIME, duration=frame.time_s)
            _log_frame(stream, run, row, frame)
        stream.disconnect()


def _log_scene(stream: "rerun.RecordingStream", run: ViewedRun) -> None:
    import rerun as rr

    moving = run.trajectory is not None
    axes = rr.ViewCoordinates.RIGHT_HAND_Z_UP if moving else rr.ViewCoordinates.RDF
    notes = rr.TextDocument(_summary(run.plume_map), media_type=rr.MediaType.MARKDOWN)
    pinhole = rr.Pinhole(
        # The upper left corner is (0, 0) here too.
        image_from_camera=run.camera.to_colmap().calibration_matrix(),
        resolution=(run.camera.width, run.camera.height),
        camera_xyz=rr.ViewCoordinates.RDF,
        image_plane_distance=FRUSTUM_SHARE * run.scene_range,
        color=_rgba(CAMERA_COLOR),
    )
    stream.log(WORLD, axes, static=True)
    stream.log("notes", notes, static=True)
    stream.log(CAMERA, pinhole, static=True)
    if len(run.points_in_world):
        points = rr.Points3D(run.points_in_world, colors=_rgba(POINT_COLOR))
        stream.log(f"{WORLD}/points", points, static=True)
    if len(run.voxels):
        voxels = rr.Points3D(run.voxels[:, :3], colors=heat_rgb(run.voxels[:, 3]))
        stream.log(f"{WORLD}/plume_voxels", voxels, static=True)
    if run.trajectory is not None:
        path = rr.LineStrips3D([run.trajectory.centers_in_world], colors=_rgba(CAMERA_COLOR))
        stream.log(f"{WORLD}/camera_path", path, static=True)
    for number, bearing in enumerate(run.plume_map.bearings, start=1):
        arrow = rr.Arrows3D(vectors=[bearing.direction_in_cam], colors=_plume_rgba(number))
        stream.log(f"{WORLD}/bearings/{number}", arrow, static=True)


def _log_plume(stream: "rerun.RecordingStream", plume: Plume) -> None:
    import rerun as rr

    root, color = f"{WORLD}/plumes/{plume.id}", _plume_rgba(plume.id)
    label = f"plume {plume.id}, probability {probability_text(plume.probability)}"
    ends = plume.points_on_axis(np.array([0.0, plume.extent_high]))
    sigmas, turn = _principal_axes(plume.source_covariance)
    ellipsoid = rr.Ellipsoids3D(
        centers=[plume.source], half_sizes=[N_SIGMA * sigmas], quaternions=[turn], colors=color
    )
    stream.log(f"{root}/source", rr.Points3D([plume.source], colors=color, labels=label),
               static=True)  # fmt: skip
    stream.log(f"{root}/covariance", ellipsoid, static=True)
    stream.log(f"{root}/axis", rr.LineStrips3D([ends], colors=color), static=True)
    if len(plume.radius_by_height) > 1:
        vertices, triangles = plume_surface(plume)
        glass = (*color[:3], COLUMN_ALPHA)
        column = rr.Mesh3D(
            vertex_positions=vertices, triangle_indices=triangles, albedo_factor=glass
        )
        stream.log(f"{root}/column", column, static=True)


def _log_frame(
    stream: "rerun.RecordingStream", run: ViewedRun, row: int, frame: ViewedFrame
) -> None:
    import rerun as rr

    if run.trajectory is not None:
        world_from_cam = rr.Transform3D(
            translation=run.trajectory.centers_in_world[row],
            mat3x3=run.trajectory.rotations[row].T,
        )
        stream.log(CAMERA, world_from_cam)
    size = frame.picture.shape[:2]
    stream.log(f"{CAMERA}/frame", _encoded(frame.picture, ".jpg", draw_order=0.0))
    if frame.detection is None:  # the viewer goes on showing an encoded picture that is cleared
        evidence = np.zeros((*size, 4), np.uint8)
        shift = np.full(size, NOT_MEASURED, np.uint8)
        stream.log(f"{WORLD}/rays", rr.Clear(recursive=False))
    else:
        evidence = evidence_layer(frame.detection.llr, run.full_scale_nats)
        shift = displacement_picture(frame.detection.displacement, run.full_scale_px)
        _log_rays(stream, run, row, frame.detection)
    stream.log(f"{CAMERA}/evidence", _encoded(evidence, ".png", draw_order=1.0))
    stream.log(f"{CAMERA}/displacement", _encoded(shift, ".png", draw_order=2.0))


def _log_rays(
    stream: "rerun.RecordingStream", run: ViewedRun, row: int, detection: Detection
) -> None:
    import rerun as rr

    if run.trajectory is not None:
        rays = rays_of_evidence(run.trajectory, row, detection, longest=FARTHEST * run.scene_range)
        colors = heat_rgb(rays.llr / run.full_scale_nats)
        stream.log(f"{WORLD}/rays", rr.LineStrips3D(list(rays.segments_in_world), colors=colors))


def _blueprint() -> "rerun.blueprint.Blueprint":
    """Space on the left; on the right the frame with its evidence, displacement, and notes."""
    import rerun.blueprint as rrb

    space = rrb.Spatial3DView(
        origin=WORLD, name="Map", contents=["$origin/**", f"- /{CAMERA}/displacement"]
    )
    frame = rrb.Spatial2DView(
        origin=CAMERA, name="Frame and evidence", contents=["$origin/frame", "$origin/evidence"]
    )
    shift = rrb.Spatial2DView(origin=CAMERA, name="Displacement", contents=["$origin/displacement"])
    notes = rrb.TextDocumentView(origin="notes", name="Notes")
    return rrb.Blueprint(
        rrb.Horizontal(space, rrb.Vertical(frame, shift, notes), column_shares=[3, 2]),
        rrb.TimePanel(timeline=FRAME),
        collapse_panels=True,
    )


def _summary(plume_map: PlumeMap) -> str:
    lines = [plume_map.limit_text(), *plume_map.notes]
    return "\n".join(f"- {line}" for line in lines)


def _encoded(
    picture: Picture | GreyImage, suffix: str, *, draw_order: float
) -> "rerun.EncodedImage":
    import rerun as rr

    _, content = cv2.imencode(suffix, picture)
    kind = {".jpg": "image/jpeg", ".png": "image/png"}[suffix]
    return rr.EncodedImage(contents=content.tobytes(), media_type=kind, draw_order=draw_order)


def _principal_axes(covariance: FloatArray) -> tuple[FloatArray, FloatArray]:
    """(3,) standard deviations and the turn of their axes as a quaternion x, y, z, w."""
    variances, axes = np.linalg.eigh(covariance)
    axes[:, 0] *= np.linalg.det(axes)
    return np.sqrt(np.maximum(variances, 0.0)), Rotation.from_matrix(axes).as_quat()


def _plume_rgba(number: int) -> tuple[int, int, int, int]:
    return _rgba(PLUME_COLORS[(number - 1) % len(PLUME_COLORS)])


def _rgba(css: str) -> tuple[int, int, int, int]:
    red, green, blue = bytes.fromhex(css.removeprefix("#"))
    return red, green, blue, 255
