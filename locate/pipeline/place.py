"""The stage that places: scale, up and position on the Earth, from the recording's telemetry."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from geometry.arrays import BoolArray, FloatArray
from geometry.errors import BadInputError
from geometry.georeference import (
    Constraint,
    Georeference,
    HeightDatum,
    ScaleConstraint,
    UpConstraint,
    fit_similarity,
)
from geometry.georeference.fixes import positions_of_cameras
from geometry.georeference.gravity import up_from_gimbal, up_from_ground
from geometry.georeference.lengths import scale_from_height
from geometry.trajectory import Trajectory
from locate.pipeline.files import RunFiles
from locate.pipeline.fingerprint import fingerprint_path
from locate.pipeline.known_lengths import KnownLengths
from locate.pipeline.placement import Placement
from locate.pipeline.points import load_points, save_points
from locate.pipeline.poses import names_of
from locate.pipeline.source import Source
from locate.recording import KeyFrames
from locate.telemetry import (
    AltitudeDatum,
    TelemetryTrack,
    estimate_offset,
    path_speeds,
    read_telemetry,
)
from locate.telemetry.track import COLUMNS

HORIZONTAL_SIGMA_M, VERTICAL_SIGMA_M = 3.0, 6.0
SHARED_SIGMA_M = (2.0, 2.0, 4.0)
PRECISE_SIGMA_M = 0.5
KNOWN_SHARE = 0.5
CAMERA_HEIGHT_SIGMA = 0.05
ON_THE_VIDEO_CLOCK = ("video subtitle", "DJI SRT")
DATUMS = {
    AltitudeDatum.ELLIPSOID: HeightDatum.ELLIPSOID,
    AltitudeDatum.MEAN_SEA_LEVEL: HeightDatum.MEAN_SEA_LEVEL,
    AltitudeDatum.TAKEOFF: HeightDatum.TAKEOFF,
    AltitudeDatum.UNKNOWN: HeightDatum.UNKNOWN,
}


def place_run(
    source: Source,
    key_frames: KeyFrames,
    lengths: KnownLengths,
    files: RunFiles,
    target: RunFiles,
) -> str:
    """Turns and scales a reconstruction to what is known of its place; returns a summary.

    Args:
        source: What its user says of it.
        key_frames: The frames.
        lengths: Known sizes in the scene.
        files: The run folder with the reconstruction.
        target: Where to write.

    Raises:
        BadInputError: What was asked for cannot be used.
    """
    trajectory = Trajectory.load(files.sfm_trajectory)
    points = load_points(files.sfm_points)
    placement = place_reconstruction(
        trajectory,
        key_frames,
        source.telemetry(),
        asked=source.config.telemetry is not None,
        camera_height_m=source.config.camera_height_m,
        points_in_world=points,
        lengths=lengths.scales(trajectory, files.frames, names_of(trajectory, key_frames)),
    )
    placement.save(target.placement)
    placement.apply(trajectory).save(target.trajectory)
    if points is not None:
        save_points(target.points, placement.apply_to_points(points))
    return placement.describe()


def place_inputs(source: Source) -> dict[str, Any]:
    """What the place depends on beside the poses."""
    distance = source.config.distance
    return {
        "telemetry": [fingerprint_path(path) for path in source.telemetry()],
        "camera_height_m": source.config.camera_height_m,
        "board": source.config.board,
        "distance": None if distance is None else fingerprint_path(distance),
    }


def place_reconstruction(
    trajectory: Trajectory,
    frames: KeyFrames,
    telemetry: Sequence[Path],
    *,
    asked: bool = False,
    camera_height_m: float | None = None,
    points_in_world: FloatArray | None = None,
    lengths: Sequence[ScaleConstraint] = (),
) -> Placement:
    """Places a reconstruction by all that is known of it.

    Telemetry that was found and not asked for is left out where it cannot be used; the notes say
    why.

    Args:
        trajectory: Of the reconstruction, its scale and up free.
        frames: The frames it is of.
        telemetry: Files that may say where it was made; the first that can be used is.
        asked: The user named that file.
        camera_height_m: Of the cameras above the ground plane, where it is known.
        points_in_world: (M, 3) sparse points.
        lengths: What known sizes in the scene say of its scale.

    Raises:
        BadInputError: What was asked for cannot be used.
    """
    ground = [*_ground(trajectory, points_in_world, camera_height_m), *lengths]
    notes: tuple[str, ...] = ()
    for path in telemetry:
        try:
            track = read_telemetry(path)
        except BadInputError:
            if asked:
                raise
            continue
        try:
            return _by_track(trajectory, frames, track, ground)
        except BadInputError as error:
            if asked:
                raise
            notes = (*notes, f"Telemetry left out: {error}.")
    if not any(isinstance(constraint, ScaleConstraint) for constraint in ground):
        return Placement(notes=notes)
    return Placement(alignment=fit_similarity(ground), notes=notes)


def _ground(
    trajectory: Trajectory, points_in_world: FloatArray | None, camera_height_m: float | None
) -> list[Constraint]:
    """Up by the ground plane, and the scale where the cameras' height above it is known."""
    if points_in_world is None:
        if camera_height_m is not None:
            raise BadInputError("the camera's height needs a reconstruction: leave --poses out")
        return []
    try:
        constraints: list[Constraint] = [up_from_ground(trajectory, points_in_world)]
        if camera_height_m is not None:
            sigma_m = CAMERA_HEIGHT_SIGMA * camera_height_m
            constraints.append(
                scale_from_height(trajectory, points_in_world, camera_height_m, sigma_m=sigma_m)
            )
    except BadInputError:
        if camera_height_m is not None:
            raise
        return []
    return constraints


def _by_track(
    trajectory: Trajectory, frames: KeyFrames, track: TelemetryTrack, ground: list[Constraint]
) -> Placement:
    records, notes = _at_frames(trajectory, frames, track)
    altitude_m, datum = records.altitude_m, DATUMS[records.altitude_datum]
    if not np.isfinite(altitude_m).any():
        altitude_m, datum = records.height_m, HeightDatum.TAKEOFF
    fixes = np.stack([records.latitude_deg, records.longitude_deg, altitude_m], axis=1)
    known = np.isfinite(fixes).all(axis=1)
    if not known.any():
        raise BadInputError(f"{track.path}: no frame has a position with a height")
    georeference = Georeference.at(fixes[known][0], datum, "first fix")
    enu = np.full(fixes.shape, np.nan)
    enu[known] = georeference.enu(fixes[known])
    sigmas_m = _sigmas_m(records, track.step_m)
    precise = bool(np.median(sigmas_m) < PRECISE_SIGMA_M)
    positions = positions_of_cameras(
        trajectory,
        enu,
        sigmas_m,
        name=track.path.name,
        shared_sigma_m=(0.0, 0.0, 0.0) if precise else SHARED_SIGMA_M,
    )
    upright = _up_by_gimbal(trajectory, records)
    ups = [c for c in ground if isinstance(c, UpConstraint)] if upright is None else [upright]
    scales = [c for c in ground if isinstance(c, ScaleConstraint)]
    alignment = fit_similarity([positions, *ups, *scales])
    return Placement(alignment=alignment, georeference=georeference, notes=notes)


def _at_frames(
    trajectory: Trajectory, frames: KeyFrames, track: TelemetryTrack
) -> tuple[TelemetryTrack, tuple[str, ...]]:
    """A record for each camera, by photo name or by time."""
    if track.times_s is None:
        sources = {frame.index: frame.source for frame in frames.frames}
        names = [sources[index] for index in trajectory.indices.tolist()]
        rows = track.rows_of(names)
        return _blanked(track.take(np.maximum(rows, 0)), rows >= 0), track.warnings
    if not frames.is_video:
        raise BadInputError(f"{track.path}: records have times, and photos only names")
    if track.kind in ON_THE_VIDEO_CLOCK:
        return track.without_repeats().at(trajectory.times_s), track.warnings
    speeds = path_speeds(trajectory.times_s, trajectory.centers_in_world)
    offset = estimate_offset(track, trajectory.times_s, speeds)
    note = (
        f"{track.path.name} was set against the video by the camera's speed: its time is the "
        f"video's plus {offset.offset_s:.2f} +- {offset.sigma_s:.2f} s."
    )
    moments_s = trajectory.times_s + offset.offset_s
    return track.without_repeats().at(moments_s), (*track.warnings, note)


def _blanked(records: TelemetryTrack, known: BoolArray) -> TelemetryTrack:
    """The records, nothing in those that are not known."""
    columns: dict[str, Any] = {
        name: np.where(known, getattr(records, name), np.nan) for name in COLUMNS
    }
    return replace(records, **columns)


def _sigmas_m(records: TelemetryTrack, step_m: float) -> FloatArray:
    """(N, 3) of the fixes: as stated, as usual for a small receiver, at least their rounding."""
    rounding_m = step_m / np.sqrt(12)
    horizontal = np.nan_to_num(records.horizontal_sigma_m, nan=HORIZONTAL_SIGMA_M)
    vertical = np.nan_to_num(records.vertical_sigma_m, nan=VERTICAL_SIGMA_M)
    horizontal = np.hypot(horizontal, rounding_m)
    return np.stack([horizontal, horizontal, vertical], axis=1)


def _up_by_gimbal(trajectory: Trajectory, records: TelemetryTrack) -> UpConstraint | None:
    """Up by the camera's own attitude, where most frames have it."""
    pitch_deg, roll_deg = records.gimbal_pitch_deg, records.gimbal_roll_deg
    known = np.isfinite(pitch_deg) & np.isfinite(roll_deg)
    if known.mean() < KNOWN_SHARE:
        return None
    return up_from_gimbal(trajectory, pitch_deg, roll_deg)
