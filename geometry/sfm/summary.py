"""From a COLMAP model to the project's own types and to plain numbers."""

from typing import Any

import numpy as np
import pycolmap

from geometry.arrays import FloatArray, IntArray
from geometry.camera import Camera
from geometry.sfm.checks import path_roughness
from geometry.trajectory import Trajectory


def registered_images(model: pycolmap.Reconstruction) -> list[pycolmap.Image]:
    """The images that have a pose."""
    return [model.image(image_id) for image_id in model.reg_image_ids()]


def poses_by_name(model: pycolmap.Reconstruction) -> dict[str, tuple[FloatArray, FloatArray]]:
    """(3, 3) cam_from_world rotation and (3,) centre of every registered image."""
    return {
        image.name: (image.cam_from_world().rotation.matrix(), image.projection_center())
        for image in registered_images(model)
    }


def rows_and_ids(model: pycolmap.Reconstruction, names: list[str]) -> tuple[IntArray, list[int]]:
    """Rows of `names` that are registered, and their image ids, in that order."""
    ids = {image.name: image.image_id for image in registered_images(model)}
    rows = [row for row, name in enumerate(names) if name in ids]
    return np.array(rows, dtype=np.int64), [ids[names[row]] for row in rows]


def model_trajectory(
    model: pycolmap.Reconstruction,
    image_ids: list[int],
    indices: IntArray,
    times_s: FloatArray,
    covariances: FloatArray | None = None,
) -> Trajectory:
    """The poses of the given images."""
    poses = [model.image(image_id).cam_from_world() for image_id in image_ids]
    return Trajectory(
        camera=Camera.from_colmap(next(iter(model.cameras.values()))),
        indices=indices,
        times_s=times_s,
        rotations=np.array([pose.rotation.matrix() for pose in poses]).reshape(-1, 3, 3),
        translations=np.array([pose.translation for pose in poses]).reshape(-1, 3),
        covariances=covariances,
    )


def sparse_points(
    model: pycolmap.Reconstruction, image_ids: list[int]
) -> tuple[FloatArray, FloatArray, tuple[IntArray, ...]]:
    """(M, 3) points, (M,) their errors in px, and the rows each image sees."""
    items = sorted(model.points3D.items())
    row_of = {point_id: row for row, (point_id, _) in enumerate(items)}
    visible = []
    for image_id in image_ids:
        seen = {p.point3D_id for p in model.image(image_id).points2D if p.has_point3D()}
        visible.append(np.array(sorted(row_of[i] for i in seen), dtype=np.int64))
    xyz = np.array([point.xyz for _, point in items]).reshape(-1, 3)
    errors_px = np.array([point.error for _, point in items], dtype=float)
    return xyz, errors_px, tuple(visible)


def view_distance(
    centers: FloatArray, points_in_world: FloatArray, visible: tuple[IntArray, ...]
) -> float:
    """Median distance from a camera to the points it sees, world units."""
    seen = zip(centers, visible, strict=True)
    distances = [np.linalg.norm(points_in_world[v] - center, axis=1) for center, v in seen]
    return float(np.median(np.concatenate(distances)))


def triangulation_angles_deg(
    centers: FloatArray, points_in_world: FloatArray, visible: tuple[IntArray, ...]
) -> FloatArray:
    """(M,) the widest angle each point is seen under."""
    cameras = np.repeat(np.arange(len(visible)), [len(rows) for rows in visible])
    rows = np.concatenate([np.zeros(0, dtype=np.int64), *visible])
    order = np.argsort(rows, kind="stable")
    rays = points_in_world[rows[order]] - centers[cameras[order]]
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    counts = np.bincount(rows, minlength=len(points_in_world))
    starts = np.cumsum(counts) - counts
    angles = np.zeros(len(points_in_world))
    for count in np.unique(counts[counts > 1]):
        alike = np.flatnonzero(counts == count)
        of_point = rays[starts[alike, None] + np.arange(count)]
        cosines = (of_point @ of_point.swapaxes(1, 2)).min(axis=(1, 2))
        angles[alike] = np.degrees(np.arccos(np.clip(cosines, -1, 1)))
    return angles


def quality_report(
    model: pycolmap.Reconstruction,
    poses: Trajectory,
    points_in_world: FloatArray,
    visible: tuple[IntArray, ...],
) -> dict[str, Any]:
    """Plain numbers on the quality of a reconstruction."""
    angles = triangulation_angles_deg(poses.centers_in_world, points_in_world, visible)
    return {
        "points": len(points_in_world),
        "points_per_image": float(np.median([len(rows) for rows in visible])),
        "reprojection_px": float(model.compute_mean_reprojection_error()),
        "focal_px": poses.camera.focal_px,
        "triangulation_angle_deg": float(np.median(angles)) if len(angles) else 0.0,
        "roughness": path_roughness(poses.centers_in_world, poses.indices),
    }
