"""The stage that places: scale, up and position on the Earth, from the recording's telemetry."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from geometry.arrays import FloatArray
from geometry.errors import BadInputError
from geometry.georeference import (
    Constraint,
    ScaleConstraint,
    fit_similarity,
)
from geometry.georeference.gravity import up_from_ground
from geometry.georeference.lengths import scale_from_height
from geometry.trajectory import Trajectory
from locate.pipeline.files import RunFiles
from locate.pipeline.fingerprint import fingerprint_path
from locate.pipeline.guessed_up import guessed_up_note, load_up_source
from locate.pipeline.known_lengths import KnownLengths
from locate.pipeline.place_by_track import place_by_track
from locate.pipeline.placement import Placement
from locate.pipeline.points import load_points, save_points
from locate.pipeline.poses import load_pose_notes, names_of
from locate.pipeline.source import RecordingSource
from locate.recording import KeyFrames
from locate.telemetry import (
    RefusedPositionsError,
    read_telemetry,
)

CAMERA_HEIGHT_SIGMA = 0.05
"""Relative standard deviation of a stated height of the cameras above the ground."""


def place_run(
    source: RecordingSource,
    key_frames: KeyFrames,
    lengths: KnownLengths,
    files: RunFiles,
    target: RunFiles,
) -> str:
    """Turns and scales a reconstruction to what is known of its place; returns a summary.

    Args:
        source: What its user states of it.
        key_frames: The frames.
        lengths: Known sizes in the scene.
        files: The run folder with the reconstruction.
        target: Where to write.

    Raises:
        BadInputError: What was asked for cannot be used.
    """
    trajectory = Trajectory.load(files.sfm_trajectory)
    recording = source.config.recording
    points = load_points(files.sfm_points)
    names = names_of(trajectory, key_frames)
    placement = place_reconstruction(
        trajectory,
        key_frames,
        source.telemetry(),
        asked=source.config.telemetry is not None,
        offset_s=source.config.telemetry_offset_s,
        camera_height_m=source.config.camera_height_m,
        points_in_world=points,
        lengths=lengths.constrain_scale(trajectory, files.frames, names),
        photos=recording if recording.is_dir() else recording.parent,
    )
    placed = placement.apply(trajectory)
    up_notes = () if placed.gravity else (guessed_up_note(load_up_source(files)),)
    notes = (*placement.notes, *up_notes, *load_pose_notes(files), *lengths.describe_unused(names))
    placement = replace(placement, notes=notes)
    placement.save(target.placement)
    placed.save(target.trajectory)
    if points is not None:
        save_points(target.points, placement.apply_to_points(points))
    return placement.describe()


def place_inputs(source: RecordingSource) -> dict[str, Any]:
    """What the place depends on beside the poses."""
    distance = source.config.distance
    return {
        "telemetry": [fingerprint_path(path) for path in source.telemetry()],
        "telemetry_offset_s": source.config.telemetry_offset_s,
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
    offset_s: float | None = None,
    camera_height_m: float | None = None,
    points_in_world: FloatArray | None = None,
    lengths: Sequence[ScaleConstraint] = (),
    photos: Path | None = None,
) -> Placement:
    """Places a reconstruction by all that is known of it.

    Telemetry that was found and not asked for is left out where it cannot be used; the notes say
    why.

    Args:
        trajectory: Of the reconstruction, its scale and up free.
        frames: The frames it is of.
        telemetry: Files that may say where it was made; the first that can be used is.
        asked: The user named that file.
        offset_s: Its time minus the video's, where the user stated it.
        camera_height_m: Of the cameras above the ground plane, where it is known.
        points_in_world: (M, 3) sparse points.
        lengths: What known sizes in the scene say of its scale.
        photos: Folder of the frames, where these are photos.

    Raises:
        BadInputError: What was asked for cannot be used.
    """
    ground = [*_ground_constraints(trajectory, points_in_world, camera_height_m), *lengths]
    notes: tuple[str, ...] = ()
    for path in telemetry:
        try:
            track = read_telemetry(path)
        except BadInputError as error:
            if asked:
                raise
            if isinstance(error, RefusedPositionsError):
                notes = (*notes, f"Telemetry left out: {error}.")
            continue
        try:
            placement = place_by_track(
                trajectory, frames, track, ground, offset_s=offset_s, photos=photos
            )
            return replace(placement, notes=(*notes, *placement.notes))
        except BadInputError as error:
            if asked:
                raise
            notes = (*notes, f"Telemetry left out: {error}.")
    if offset_s is not None:
        raise BadInputError(
            "--telemetry-offset: no telemetry can be used; name it with --telemetry, or leave the "
            + " ".join(("offset out.", *notes))
        )
    if not any(isinstance(constraint, ScaleConstraint) for constraint in ground):
        return Placement(notes=notes)
    return Placement(alignment=fit_similarity(ground), notes=notes)


def _ground_constraints(
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
