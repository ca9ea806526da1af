"""Structure from motion on real photos, against ground truth, GPS or a published reconstruction.

    python -m benchmarks.sfm [DATA_DIR] [--only NAME ...] [--plants FOLDER ...] [--sift]

DATA_DIR holds `2_sfm/` and `2_dense_video/`. `sample` is the bundled recording; `--plants` adds
recordings of `locate simulate` or `benchmarks.scenes orbit` with their truth.json. Each of these
is also measured edited (`benchmarks/common/edited.py`): `sample-h264`. Sets without a truth have
only the report of the reconstruction. `--sift` leaves tracks out. Prints a table; `--json FILE`
writes the same numbers, unrounded.
"""

import argparse
import json
import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from fnmatch import fnmatch
from itertools import product
from pathlib import Path

import cv2
import numpy as np
from scipy.spatial.transform import Rotation

from benchmarks.common.edited import EDITS, video_of, write_edited
from geometry.arrays import FloatArray
from geometry.camera import Camera
from geometry.errors import BadInputError, LocateError
from geometry.named_poses import resize_camera
from geometry.pose_files import read_named_poses
from geometry.sfm import Reconstruction, reconstruct
from geometry.sfm.checks import compare_paths
from geometry.sfm.covariance import gauge_projector
from geometry.similarity import Similarity, align_points
from geometry.trajectory import Trajectory
from locate.recording import KeyFrames, open_recording, select_frames

DEFAULT_DATA = Path(__file__).parents[1] / "../shared/data"
SAMPLE = Path(__file__).parents[1] / "locate/data/sample"
NEIGHBOUR = 5
"""Frames between two whose relative rotation is compared with the truth."""
Poses = dict[str, tuple[FloatArray, FloatArray]]
Measure = Callable[[Reconstruction, KeyFrames], dict[str, float]]


@dataclass(frozen=True, kw_only=True)
class BenchmarkSet:
    """Photos or a video, and what their poses are held against."""

    source: Path
    measure: Measure
    camera: Camera | None = None


def strecha_truth(folder: Path) -> Poses:
    """cam_from_world rotation and centre in metres of each photo."""
    content = json.loads((folder / "ground_truth_half_res.json").read_text())
    return {
        name: (np.array(p["R_cam_to_world"]).T, np.array(p["centre_world_m"]))
        for name, p in content.items()
    }


def published_truth(path: Path) -> Poses:
    """The poses of a COLMAP model or transforms.json, by file name."""
    named = read_named_poses(path)
    centers = named.trajectory.centers_in_world
    return {
        Path(name).name: (named.trajectory.rotations[i], centers[i])
        for i, name in enumerate(named.names)
    }


def strecha_camera(folder: Path) -> Camera:
    """The calibration of the half-size photos, principal point from the first pixel's centre."""
    content = json.loads((folder / "ground_truth_half_res.json").read_text())
    first = next(iter(content.values()))
    params = tuple(float(first[key]) for key in ("fx", "fy", "cx", "cy"))
    return Camera(model="PINHOLE", width=first["width"], height=first["height"], params=params)


def run(
    images: Path, workdir: Path, camera: Camera | None = None, *, by_tracks: bool = True
) -> tuple[Reconstruction, KeyFrames]:
    """The key frames and the reconstruction of a recording, as `locate run` makes them."""
    frames = select_frames(open_recording(images), workdir / "frames")
    found = reconstruct(
        workdir / "frames",
        frames.names,
        frames.indices,
        frames.times_s,
        camera=None if camera is None else resize_camera(camera, frames.width, frames.height),
        focal_prior_px=frames.focal_prior_px,
        workdir=workdir / "sfm",
        ordered=frames.is_video,
        by_tracks=by_tracks,
    )
    return found, frames


def against_poses(truth: Poses) -> Measure:
    """Median centre and rotation error after a Sim(3) alignment of the centres."""

    def measure(found: Reconstruction, frames: KeyFrames) -> dict[str, float]:
        source = {frame.name: frame.source for frame in frames.frames}
        rows = [i for i, name in enumerate(found.names) if source[name] in truth]
        known = [truth[source[found.names[i]]] for i in rows]
        centers = found.trajectory.centers_in_world[rows]
        true_centers = np.array([center for _, center in known])
        true_rotations = np.array([rotation for rotation, _ in known])
        errors = np.linalg.norm(align_points(centers, true_centers)(centers) - true_centers, axis=1)
        poses = found.trajectory.take(rows)
        difference = compare_paths(poses.rotations, centers, true_rotations, true_centers)
        span = float(np.sqrt(((true_centers - true_centers.mean(axis=0)) ** 2).sum(axis=1).mean()))
        return {
            "center_median": float(np.median(errors)),
            "center_share_of_span": float(np.median(errors)) / span,
            "rotation_median_deg": difference.rotation_deg,
            "nees_per_dof": nees(poses, true_rotations, true_centers),
        }

    return measure


def against_simulation(truth_path: Path) -> Measure:
    """Error of the path in mm, of rotations in all and between neighbours, and of the focal length.

    Neighbours are `NEIGHBOUR` frames apart; the others are after a Sim(3) alignment.
    """

    def measure(found: Reconstruction, _: KeyFrames) -> dict[str, float]:
        truth = Trajectory.load(truth_path)
        row_of = {index: row for row, index in enumerate(truth.indices.tolist())}
        truth = truth.take([row_of[index] for index in found.trajectory.indices.tolist()])
        centers, true_centers = found.trajectory.centers_in_world, truth.centers_in_world
        errors = np.linalg.norm(align_points(centers, true_centers)(centers) - true_centers, axis=1)
        steps, true_steps = (
            p.rotations[NEIGHBOUR:] @ np.swapaxes(p.rotations[:-NEIGHBOUR], 1, 2)
            for p in (found.trajectory, truth)
        )
        turns = Rotation.from_matrix(steps @ np.swapaxes(true_steps, 1, 2)).magnitude()
        rotations = (found.trajectory.rotations, centers, truth.rotations, true_centers)
        return {
            "path_rms_mm": 1e3 * float(np.sqrt((errors**2).mean())),
            "rotation_median_deg": compare_paths(*rotations).rotation_deg,
            "neighbour_deg": float(np.degrees(np.median(turns))),
            "focal_percent": 100 * (found.trajectory.camera.focal_px / truth.camera.focal_px - 1),
            "nees_per_dof": nees(found.trajectory, truth.rotations, true_centers),
        }

    return measure


def without_truth(_: Reconstruction, __: KeyFrames) -> dict[str, float]:
    """Nothing: there is only the report of the reconstruction."""
    return {}


def nees(poses: Trajectory, true_rotations: FloatArray, true_centers: FloatArray) -> float:
    """Mean normalised error squared over 6; 1 where the stated covariances are right."""
    moved = poses.transformed(align_points(poses.centers_in_world, true_centers))
    if moved.covariances is None:
        return float("nan")
    turns = moved.rotations @ np.swapaxes(true_rotations, 1, 2)
    shifts = np.einsum("nij,nj->ni", moved.rotations, true_centers - moved.centers_in_world)
    errors = np.concatenate([Rotation.from_matrix(turns).as_rotvec(), shifts], axis=1)
    projector = gauge_projector(moved.rotations, moved.translations)
    relative = (projector @ errors.ravel()).reshape(-1, 6)
    scaled = np.linalg.solve(moved.covariances, relative[:, :, None])[:, :, 0]
    return float((relative * scaled).sum(axis=1).mean() / 6)


def against_gps(folder: Path) -> Callable[[Reconstruction, KeyFrames], dict[str, float]]:
    """Median distance in m to the EXIF positions after a robust Sim(3) alignment."""

    def measure(found: Reconstruction, frames: KeyFrames) -> dict[str, float]:
        source = {frame.name: frame.source for frame in frames.frames}
        enu = local_enu([folder / source[name] for name in found.names])
        centers = found.trajectory.centers_in_world
        errors = np.linalg.norm(robust_align(centers, enu)(centers) - enu, axis=1)
        return {"gps_residual_median_m": float(np.median(errors))}

    return measure


def local_enu(photos: list[Path]) -> FloatArray:
    """(N, 3) positions from EXIF in m, east north up of the first photo."""
    import pycolmap

    positions = [exif_position(photo) for photo in photos]
    wgs84 = pycolmap.GPSTransform(pycolmap.GPSTransformEllipsoid.WGS84)
    latitude, longitude, altitude = positions[0]
    return np.asarray(wgs84.ellipsoid_to_enu(np.array(positions), latitude, longitude, altitude))


def exif_position(photo: Path) -> tuple[float, float, float]:
    """Latitude and longitude in degrees, altitude in m."""
    import pycolmap

    bitmap = pycolmap.Bitmap.read(str(photo), as_rgb=False)
    if bitmap is None:
        raise BadInputError(f"{photo}: not a photo that can be read")
    latitude, longitude = bitmap.exif_latitude(), bitmap.exif_longitude()
    altitude = bitmap.exif_altitude()
    if latitude is None or longitude is None or altitude is None:
        raise BadInputError(f"{photo}: no position in its EXIF")
    return latitude, longitude, altitude


def robust_align(source: FloatArray, target: FloatArray) -> Similarity:
    """Sim(3) by iterative removal of the worst (residual above three medians)."""
    kept = np.ones(len(source), dtype=bool)
    for _ in range(10):
        fit = align_points(source[kept], target[kept])
        errors = np.linalg.norm(fit(source) - target, axis=1)
        kept = errors < 3 * np.median(errors)
    return fit


def all_sets(data: Path, rendered: Sequence[Path]) -> dict[str, BenchmarkSet]:
    """Every set by its name."""
    sfm, dense, clips = (data / name for name in ("2_sfm", "2_dense_video", "2_video_plume_free"))
    fountain, herz_jesus = sfm / "strecha_fountain-P11", sfm / "strecha_Herz-Jesus-P25"
    brighton = sfm / "drone_brighton_beach_gps" / "images_half"
    caliterra = sfm / "drone_caliterra_gps" / "images_half"
    lund, fox = sfm / "lund_door", sfm / "fox_handheld"
    photos = {
        "fountain-P11": (fountain / "images_half", against_poses(strecha_truth(fountain))),
        "Herz-Jesus-P25": (herz_jesus / "images_half", against_poses(strecha_truth(herz_jesus))),
        "brighton_beach": (brighton, against_gps(brighton)),
        "caliterra": (caliterra, against_gps(caliterra)),
        "lund_door": (
            lund / "images",
            against_poses(published_truth(lund / "colmap_ground_truth")),
        ),
        "fox": (fox / "images", against_poses(published_truth(fox / "transforms.json"))),
    }
    dense_recordings = {
        "kitchen": dense / "kitchen_NOLICENCE",
        "kitchen-plume": dense / "kitchen_semireal_NOLICENCE/1px/frames",
        "cows": dense / "cows_NOLICENCE",
        "drone-at-rest": dense / "euroc_v101_start",
        "family": clips / "Family.mp4",
        "teddybear": clips / "teddybear.mp4",
        "lady-running": clips / "lady-running.mp4",
    }
    calibrated = BenchmarkSet(
        source=fountain / "images_half",
        measure=against_poses(strecha_truth(fountain)),
        camera=strecha_camera(fountain),
    )
    return (
        {"fountain-P11 K": calibrated}
        | {name: BenchmarkSet(source=p, measure=m) for name, (p, m) in photos.items()}
        | {
            name: BenchmarkSet(source=path, measure=without_truth)
            for name, path in dense_recordings.items()
        }
        | {
            folder.name: BenchmarkSet(
                source=video_of(folder),
                measure=against_simulation(folder / "truth.json"),
            )
            for folder in rendered
        }
    )


def describe(found: Reconstruction, frames: KeyFrames) -> str:
    """The report of the reconstruction, in a line."""
    report = found.report
    lost = report["tracks_lost"]
    return (
        f"{report['registered_frames']:3}/{len(frames):<3} "
        f"{report['tied_by']:6} {report['method']:12} "
        f"f {report['focal_px']:.1f} (prior {report['focal_prior_px'] or 0:.1f}) "
        f"reprojection {report['reprojection_px']:.2f} sigma {report['residual_sigma_px']:.2f} px "
        f"opinion {report['second_opinion_center_share']!s:.6} "
        f"support {report['epipolar_support']:.2f} up {report['up_from']}"
        f"{f' no tracks: {lost}' if lost else ''}"
    )


def measure_set(name: str, one: BenchmarkSet, *, by_tracks: bool) -> dict[str, float]:
    """Prints a line of the table; nothing measured where the frames cannot be registered."""
    with tempfile.TemporaryDirectory() as folder:
        start = time.process_time()
        try:
            found, frames = run(one.source, Path(folder), one.camera, by_tracks=by_tracks)
        except LocateError as error:
            print(f"{name:15} {time.process_time() - start:6.1f} s  {error}", flush=True)
            return {}
        cpu_s = time.process_time() - start
        measured = one.measure(found, frames)
    numbers = {k: round(v, 5) for k, v in measured.items()}
    print(f"{name:15} {cpu_s:6.1f} s  {describe(found, frames)}  {numbers}", flush=True)
    return measured | {"registered": len(found.trajectory), "cpu_s": cpu_s}


def main() -> None:
    """Prints the table."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.sfm",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("data", nargs="?", type=Path, default=DEFAULT_DATA)
    parser.add_argument(
        "--only", nargs="+", default=["*"], help="names of sets; * for any characters"
    )
    parser.add_argument("--plants", type=Path, nargs="*", default=())
    parser.add_argument("--sift", action="store_true", help="leave tracks out")
    parser.add_argument("--json", type=Path)
    arguments = parser.parse_args()
    cv2.setNumThreads(1)

    def is_wanted(name: str) -> bool:
        return any(fnmatch(name, pattern) for pattern in arguments.only)

    every: dict[str, dict[str, float]] = {}
    with tempfile.TemporaryDirectory() as folder:
        rendered = [SAMPLE, *arguments.plants]
        for source, edit in product(rendered[:], EDITS):
            target = Path(folder) / f"{source.name}-{edit}"
            if is_wanted(target.name):
                write_edited(source, edit, target)
                rendered.append(target)
        sets = all_sets(arguments.data, rendered)
        for name, one in sets.items():
            if is_wanted(name):
                every[name] = measure_set(name, one, by_tracks=not arguments.sift)
    if arguments.json:
        arguments.json.write_text(json.dumps(every))


if __name__ == "__main__":
    main()
