"""A reconstruction placed by telemetry: positions and attitudes of the camera."""

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
    SourceReport,
    UpConstraint,
    fit_similarity,
)
from geometry.georeference.fixes import positions_of_cameras
from geometry.georeference.gravity import up_from_gimbal
from geometry.printable import printable
from geometry.trajectory import Trajectory
from locate.pipeline.placement import Placement
from locate.recording import KeyFrames
from locate.telemetry import AltitudeDatum, TelemetryTrack, estimate_offset, path_speeds
from locate.telemetry.photo_clock import moments_of_photos
from locate.telemetry.track import COLUMNS

HORIZONTAL_SIGMA_M, VERTICAL_SIGMA_M = 3.0, 6.0
"""Standard deviations of a fix of a small receiver, where none is stated."""
SHARED_SIGMA_M = (2.0, 2.0, 4.0)
"""Standard deviations of the error that all fixes of a flight share."""
PRECISE_SIGMA_M = 0.5
"""Fixes better than this are RTK or surveyed: they share no error."""
UNKNOWN_HEIGHT_M, DEFINED_HEIGHT_M = 1000.0, 0.1
"""Standard deviations of heights that a track does not hold, and of the one they count from."""
FLAT = (
    "holds no heights: the map is placed horizontally, and its heights count from the first camera "
    "with a position."
)
KNOWN_SHARE = 0.5
"""Attitudes are used where at least this share of the frames has one."""
ON_THE_VIDEO_CLOCK = ("video subtitle", "DJI SRT", "ASS subtitles", "GoPro GPMF")
"""Kinds of telemetry whose times are those of the video."""
DATUMS = {
    AltitudeDatum.ELLIPSOID: HeightDatum.ELLIPSOID,
    AltitudeDatum.MEAN_SEA_LEVEL: HeightDatum.MEAN_SEA_LEVEL,
    AltitudeDatum.TAKEOFF: HeightDatum.TAKEOFF,
    AltitudeDatum.UNKNOWN: HeightDatum.UNKNOWN,
}


def place_by_track(
    trajectory: Trajectory,
    frames: KeyFrames,
    track: TelemetryTrack,
    ground: Sequence[Constraint],
    *,
    offset_s: float | None = None,
    photos: Path | None = None,
) -> Placement:
    """Places a reconstruction by the positions, and the attitude, of a telemetry track.

    Args:
        trajectory: Of the reconstruction, its scale and up free.
        frames: The frames it is of.
        track: Where the camera was.
        ground: What the ground and known lengths say of up and scale.
        offset_s: Time of the track minus that of the recording, where it is known.
        photos: Folder of the frames, where these are photos, for the times they were taken.

    Raises:
        BadInputError: The track has no position for the frames, or contradicts the rest.
    """
    records, notes = _records_at_frames(trajectory, frames, track, offset_s, photos)
    upright = _up_from_attitude(trajectory, records)
    ups = [c for c in ground if isinstance(c, UpConstraint)] if upright is None else [upright]
    altitude_m, datum = records.altitude_m, DATUMS[records.altitude_datum]
    if not np.isfinite(altitude_m).any():
        altitude_m, datum = records.height_m, HeightDatum.TAKEOFF
    has_heights = bool(np.isfinite(altitude_m).any())
    if not has_heights and ups and records.has_position.any():
        altitude_m, datum = np.zeros(len(records)), HeightDatum.UNKNOWN
        notes = (*notes, f"{track.path.name} {FLAT}")
    fixes = np.stack([records.latitude_deg, records.longitude_deg, altitude_m], axis=1)
    known = np.isfinite(fixes).all(axis=1)
    if not known.any():
        raise BadInputError(f"{track.path}: no frame has a position with a height")
    if not known.all():
        lost = np.count_nonzero(~known)
        notes = (*notes, f"{track.path.name}: {lost} of {len(fixes)} frames have no position in it")
    georeference = Georeference.from_origin(fixes[known][0], datum, "first fix")
    enu = np.full(fixes.shape, np.nan)
    enu[known] = georeference.to_enu(fixes[known])
    sigmas_m = _sigmas_m(records, track.step_m)
    precise = bool(np.median(sigmas_m) < PRECISE_SIGMA_M)
    shared_m = (0.0, 0.0, 0.0) if precise else SHARED_SIGMA_M
    if not has_heights:
        sigmas_m[:, 2] = UNKNOWN_HEIGHT_M
        sigmas_m[np.flatnonzero(known)[0], 2] = DEFINED_HEIGHT_M
        shared_m = (*shared_m[:2], 0.0)
    positions = positions_of_cameras(
        trajectory, enu, sigmas_m, name=printable(track.path.name), shared_sigma_m=shared_m
    )
    scales = [c for c in ground if isinstance(c, ScaleConstraint)]
    alignment = fit_similarity([positions, *ups, *scales])
    notes = (*notes, *_describe_outliers(alignment.sources[0]))
    return Placement(alignment=alignment, georeference=georeference, notes=notes)


def _describe_outliers(fixes: SourceReport) -> tuple[str, ...]:
    """A note on positions that contradict the rest; none where they agree."""
    if not fixes.outliers:
        return ()
    return (
        f"{fixes.name}: {fixes.outliers} of {fixes.count} positions contradict the path that the "
        f"images show and hardly count; half of all are over {fixes.median_residual:.2g} m off.",
    )


def _records_at_frames(
    trajectory: Trajectory,
    frames: KeyFrames,
    track: TelemetryTrack,
    offset_s: float | None,
    photos: Path | None,
) -> tuple[TelemetryTrack, tuple[str, ...]]:
    """A record for each camera, by photo name or by time."""
    if track.times_s is None:
        if offset_s is not None:
            raise BadInputError(
                f"{track.path}: records belong to photos and have no times; leave "
                "--telemetry-offset out"
            )
        rows = track.rows_of(_sources(trajectory, frames))
        return _mask_unknown(track.take(np.maximum(rows, 0)), rows >= 0), track.warnings
    if not frames.is_video:
        if photos is None:
            raise BadInputError(f"{track.path}: records have times, and photos only names")
        taken = moments_of_photos(photos, _sources(trajectory, frames), track, offset_s)
        records = track.without_repeats().at(taken.times_s, max_gap_s=track.usual_gap_s)
        return records, (*track.warnings, *taken.notes)
    notes = track.warnings
    if offset_s is None and track.kind in ON_THE_VIDEO_CLOCK:
        offset_s = 0.0
    elif offset_s is None:
        speeds = path_speeds(trajectory.times_s, trajectory.centers_in_world)
        found = estimate_offset(track, trajectory.times_s, speeds)
        offset_s = found.offset_s
        note = (
            f"{track.path.name} was set against the video by the camera's speed: its time is the "
            f"video's plus {offset_s:.2f} +- {found.sigma_s:.2f} s."
        )
        notes = (*notes, note)
    moments_s = trajectory.times_s + offset_s
    return track.without_repeats().at(moments_s, max_gap_s=track.usual_gap_s), notes


def _sources(trajectory: Trajectory, frames: KeyFrames) -> list[str]:
    """The file of each camera."""
    sources = {frame.index: frame.source for frame in frames.frames}
    return [sources[index] for index in trajectory.indices.tolist()]


def _mask_unknown(records: TelemetryTrack, known: BoolArray) -> TelemetryTrack:
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


def _up_from_attitude(trajectory: Trajectory, records: TelemetryTrack) -> UpConstraint | None:
    """Up by the camera's own attitude, where most frames have it."""
    pitch_deg, roll_deg = records.gimbal_pitch_deg, records.gimbal_roll_deg
    known = np.isfinite(pitch_deg) & np.isfinite(roll_deg)
    if known.mean() < KNOWN_SHARE:
        return None
    return up_from_gimbal(trajectory, pitch_deg, roll_deg)
