"""Frames to poses: match, map, compare with a second method, adjust, check, normalise."""

import errno
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pycolmap

from geometry.angle_of_view import refuse_wide_lens
from geometry.arrays import FloatArray, IntArray
from geometry.camera import Camera
from geometry.errors import BadInputError, LocateError, RegistrationError, RegistrationFailure
from geometry.image_files import read_image
from geometry.lens_calibration import LensName
from geometry.reports import Report
from geometry.sfm import checks, features, mapping, pairing, result, summary, tracks, zooms
from geometry.sfm.covariance import AdjustmentErrors, TiedBy
from geometry.sfm.gauge import normalising_transform
from geometry.sfm.job import MappingJob, ProgressMeter
from geometry.threads import call_both

FATAL_ONLY = 3  # every other failure is reported through an exception


@dataclass(frozen=True, kw_only=True)
class _MappedModel:
    model: pycolmap.Reconstruction
    method: str
    difference: checks.PathDisagreement


def reconstruct(
    image_dir: Path,
    names: Sequence[str],
    indices: IntArray,
    times_s: FloatArray,
    *,
    camera: Camera | None = None,
    focal_prior_px: float | None = None,
    lens: LensName | None = None,
    workdir: Path,
    ordered: bool = True,
    by_tracks: bool = True,
    jobs: int = 1,
    progress: Report | None = None,
) -> result.Reconstruction:
    """Estimates the pose of every frame, the camera, and a sparse set of points.

    The world is a scene frame: Z up as a guess, 10 units from the cameras to the points they see.
    Frames are tied together by tracks, and far ones by SIFT matches. SIFT alone does it where
    tracks break, as between photos, and where they do not give every frame a sound pose: `report`
    says which (`tied_by`) and why (`tracks_lost`).

    Args:
        image_dir: Folder of the images.
        names: N file names in it, in order of time where `ordered`.
        indices: (N,) index of each in its recording.
        times_s: (N,) time of each.
        camera: A known camera, kept as it is.
        focal_prior_px: Focal length from metadata, refined and checked; ignored with `camera`.
        lens: What is estimated of the lens without `camera`; by default one radial term.
        workdir: Where the database and the COLMAP model (``model/``) go.
        ordered: Frames of a video. Where there are no tracks, photos are each matched with every
            other instead, up to 60; more are matched with those near them in the order of
            `names`, as a video is.
        by_tracks: Try tracks first.
        jobs: Threads that work side by side; the result does not depend on it.
        progress: Called with a stage name and the fraction of the whole call, which never falls.

    Raises:
        BadInputError: An image cannot be read or does not fit the camera, or the lens sees more
            than 120 degrees.
        RegistrationError: The frames cannot be registered; the cause is named.
        OSError: COLMAP cannot write or read its files.
    """
    pycolmap.logging.minloglevel = FATAL_ONLY  # pycolmap.bundle_adjustment elsewhere resets it
    report_progress = ProgressMeter(progress)
    names = list(names)
    if len(names) < checks.MIN_FRAMES:
        raise checks.registration_error(RegistrationFailure.TOO_FEW_FRAMES, f"{len(names)} frames")
    height, width = read_image(image_dir / names[0]).shape
    start = features.starting_camera(width, height, camera, focal_prior_px, lens)
    if camera is not None and (camera.width, camera.height) != (width, height):
        raise BadInputError(
            f"the camera is for {camera.width}x{camera.height} images, "
            f"{names[0]} is {width}x{height}"
        )
    workdir.mkdir(parents=True, exist_ok=True)
    job = MappingJob(
        image_dir=image_dir,
        names=names,
        indices=indices,
        times_s=times_s,
        workdir=workdir,
        start=start,
        refine=camera is None,
        focal_prior_px=focal_prior_px,
        ordered=ordered,
        progress=report_progress,
        jobs=jobs,
    )
    with _colmap_errors(job.database):
        found = _solve_by_either(job) if by_tracks else _solve_by_sift(job)
    report_progress("adjusting", 1.0)
    return found


@contextmanager
def _colmap_errors(database: Path) -> Iterator[None]:
    """COLMAP raises RuntimeError where it cannot read or write its files."""
    try:
        yield
    except RuntimeError as error:
        raise OSError(errno.EIO, " ".join(str(error).split()), str(database)) from error


def _solve_by_either(job: MappingJob) -> result.Reconstruction:
    """By tracks where they hold, by SIFT where not."""
    try:
        return _solve_by_tracks(job)
    except tracks.BrokenTracksError as error:
        found = _solve_by_sift(job)
        return replace(found, report=found.report | {"tracks_lost": str(error)})


def _solve_by_sift(job: MappingJob) -> result.Reconstruction:
    return _solve(replace(job, pairs=pairing.pair_by_sift(job)), "SIFT")


def _solve_by_tracks(job: MappingJob) -> result.Reconstruction:
    """Raises BrokenTracksError where tracks break or do not give every frame a sound pose."""
    pairs = pairing.pair_by_tracks(job)
    try:
        found = _solve(replace(job, pairs=pairs), "tracks")
    except LocateError as error:
        raise tracks.BrokenTracksError(str(error).partition(":")[0]) from error
    if len(found.names) < len(job.names):
        raise tracks.BrokenTracksError(f"{len(found.names)} of {len(job.names)} frames get a pose")
    return found


def _solve(job: MappingJob, tied_by: TiedBy) -> result.Reconstruction:
    """Poses from the pairs of the database."""
    checks.check_matches(job.pairs, Camera.from_colmap(job.start), len(job.names))
    solution = _map_and_verify(job)
    if tied_by == "tracks" and not solution.difference.is_tolerable:
        raise checks.registration_error(
            RegistrationFailure.IMPLAUSIBLE_POSES, "two methods take tracks for different paths"
        )
    job.progress("adjusting", 0.0)
    mapping.adjust_bundle(solution.model, refine_camera=job.refine)
    _check_zoom(solution.model)
    return _finish_reconstruction(job, solution, tied_by)


def _map_and_verify(job: MappingJob) -> _MappedModel:
    """Global mapping where a second method agrees with it, incremental mapping where not."""
    job.progress("mapping", 0.0)
    models, (subset, complete) = call_both(
        job.jobs, partial(_map_globally, job), partial(_map_second_method, job)
    )
    job.progress("mapping", 0.5)
    reasons = []
    if models and subset and _registered_share(models[0], job) >= checks.MIN_SHARE:
        difference = _compare_models(models[0], subset[0])
        if difference.is_tolerable and _epipolar_support(models[0], job) >= checks.MIN_SUPPORT:
            return _MappedModel(model=models[0], method="global", difference=difference)
        share = f"{difference.center_share:.0%} of the path"
        reasons.append(f"mapping all frames at once and some one by one differ by {share}")
    full = subset if complete else _map_incrementally(job, job.names)
    if full and _registered_share(full[0], job) >= checks.MIN_SHARE:
        reference = models if complete else subset
        support = _epipolar_support(full[0], job)
        difference = _compare_models(full[0], reference[0]) if reference else checks.NOT_COMPARED
        needed = checks.MIN_SUPPORT if difference.is_tolerable else checks.MIN_SUPPORT_ALONE
        if support >= needed and (difference.is_tolerable or complete):
            return _MappedModel(model=full[0], method="incremental", difference=difference)
        reasons.append("mapping all one by one differs as well")
    raise _failure_of(job, full or models, reasons)


def _map_globally(job: MappingJob) -> list[pycolmap.Reconstruction]:
    return mapping.map_globally(
        job.database, job.image_dir, job.workdir / "global", refine_camera=job.refine
    )


def _map_second_method(job: MappingJob) -> tuple[list[pycolmap.Reconstruction], bool]:
    """Incremental mapping of a spread subset; True where it had to be all images."""
    count = len(job.names)
    stride = 2 ** max(0, int(np.log2(count / checks.SECOND_METHOD_FRAMES)))
    while stride > 1:
        subset = job.names[::stride]
        models = _map_incrementally(job, subset)
        if models and models[0].num_reg_images() >= checks.MIN_SHARE * len(subset):
            return models, False
        stride //= 2
    return _map_incrementally(job, job.names), True


def _map_incrementally(job: MappingJob, names: list[str]) -> list[pycolmap.Reconstruction]:
    done = 0

    def on_image() -> None:
        nonlocal done
        done += 1
        job.progress("mapping", 0.5 + 0.5 * min(1.0, done / len(names)))

    return mapping.map_incrementally(
        job.database,
        job.image_dir,
        job.workdir / "incremental",
        refine_camera=job.refine,
        names=names,
        on_image=on_image if len(names) == len(job.names) else None,
    )


def _check_zoom(model: pycolmap.Reconstruction) -> None:
    """Raises where the images are of several zooms, which one camera would place wrongly."""
    by_name = zooms.focal_lengths_by_image(model)
    names, focal_px = list(by_name), np.array(list(by_name.values()))
    groups = zooms.group_zooms(focal_px)
    if len(groups) > 1:
        raise checks.registration_error(
            RegistrationFailure.SEVERAL_ZOOMS, zooms.describe_zooms(names, focal_px, groups)
        )


def _registered_share(model: pycolmap.Reconstruction, job: MappingJob) -> float:
    return float(model.num_reg_images() / len(job.names))


def _epipolar_support(model: pycolmap.Reconstruction, job: MappingJob) -> float:
    row_of = {name: row for row, name in enumerate(job.names)}
    poses = {row_of[i.name]: i.cam_from_world() for i in summary.registered_images(model)}
    return checks.epipolar_support(job.pairs, next(iter(model.cameras.values())), poses)


def _compare_models(
    a: pycolmap.Reconstruction, b: pycolmap.Reconstruction
) -> checks.PathDisagreement:
    poses_a, poses_b = summary.poses_by_name(a), summary.poses_by_name(b)
    common = sorted(poses_a.keys() & poses_b.keys())
    if not common:
        return checks.NOT_COMPARED
    return checks.compare_paths(
        np.array([poses_a[name][0] for name in common]),
        np.array([poses_a[name][1] for name in common]),
        np.array([poses_b[name][0] for name in common]),
        np.array([poses_b[name][1] for name in common]),
    )


def _failure_of(
    job: MappingJob, models: list[pycolmap.Reconstruction], reasons: list[str]
) -> RegistrationError:
    count = len(job.names)
    connected, parts = checks.largest_component(job.pairs, count)
    if reasons and connected >= checks.MIN_SHARE * count:
        return checks.registration_error(RegistrationFailure.IMPLAUSIBLE_POSES, ", ".join(reasons))
    registered = models[0].num_reg_images() if models else 0
    what = f"{registered} of {count} frames registered"
    if parts > 1 or len(models) > 1:
        return checks.registration_error(
            RegistrationFailure.SPLIT_MODELS, f"{what}, in {max(parts, len(models))} parts"
        )
    if connected < checks.MIN_SHARE * count or models:
        return checks.registration_error(RegistrationFailure.LOW_TEXTURE, what)
    return checks.registration_error(
        RegistrationFailure.PURE_ROTATION, f"{what}, no depth to be seen"
    )


def _finish_reconstruction(
    job: MappingJob, solution: _MappedModel, tied_by: TiedBy
) -> result.Reconstruction:
    model = solution.model
    camera = next(iter(model.cameras.values()))
    side = max(camera.width, camera.height)
    if job.refine:
        checks.check_focal(camera.mean_focal_length(), job.focal_prior_px, side)
        refuse_wide_lens(Camera.from_colmap(camera))
    rows, ids = summary.rows_and_ids(model, job.names)
    raw = summary.model_trajectory(model, ids, job.indices[rows], job.times_s[rows])
    points, errors_px, visible = summary.sparse_points(model, ids)
    distance = summary.view_distance(raw.centers_in_world, points, visible)
    scene_from_model, up_source = normalising_transform(raw, points, distance)
    model.transform(
        pycolmap.Sim3d(
            scene_from_model.scale,
            pycolmap.Rotation3d(scene_from_model.rotation),
            scene_from_model.translation,
        )
    )
    errors = AdjustmentErrors.of(model, refined_camera=job.refine, tied_by=tied_by)
    points = scene_from_model(points)
    trajectory = summary.model_trajectory(
        model, ids, job.indices[rows], job.times_s[rows], errors.pose_covariances(ids)
    )
    report = summary.quality_report(model, trajectory, points, visible)
    report |= _report_of(job, solution, errors, tied_by) | {"up_from": up_source}
    checks.check_quality(report, ordered=job.ordered)
    folder = job.workdir / "model"
    folder.mkdir(exist_ok=True)
    model.write(folder)
    return result.Reconstruction(
        trajectory=trajectory,
        names=tuple(job.names[row] for row in rows),
        points_in_world=points,
        point_errors_px=errors_px,
        visible=visible,
        report={key: _finite_or_none(value) for key, value in report.items()},
    )


def _report_of(
    job: MappingJob, solution: _MappedModel, errors: AdjustmentErrors, tied_by: TiedBy
) -> dict[str, Any]:
    """How the model was found, and how well its methods, its matches and its residuals agree."""
    registered = solution.model.num_reg_images()
    return {
        "method": solution.method,
        "tied_by": tied_by,
        "tracks_lost": None,
        "registered_share": registered / len(job.names),
        "registered_frames": registered,
        "second_opinion_center_share": solution.difference.center_share,
        "second_opinion_rotation_deg": solution.difference.rotation_deg,
        "second_opinion_frames": solution.difference.count,
        "epipolar_support": _epipolar_support(solution.model, job),
        "focal_prior_px": job.focal_prior_px,
        "residual_sigma_px": errors.residual_sigma_px,
        "focal_sigma_px": errors.focal_sigma_px if job.refine else None,
    }


def _finite_or_none(value: Any) -> Any:
    """None for a number that JSON does not know: nothing was measured."""
    return None if isinstance(value, float) and not np.isfinite(value) else value
