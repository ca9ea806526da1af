"""Covariance of every camera pose from the bundle adjustment, in gtsam's tangent.

A reconstruction from images alone is free to move, turn and grow as a whole, so a pose covariance
exists only relative to something. Here that is the trajectory itself: the covariance of what
remains after the best similarity transform of all cameras (inner constraints, an S-transformation:
Baarda 1973; Triggs et al., Bundle Adjustment, 2000, section 9). No camera is special and none is
left out.
"""

from dataclasses import dataclass
from typing import Literal, Self

import numpy as np
import pycolmap

from geometry.arrays import FloatArray, IntArray
from geometry.normal_errors import MAD_TO_SIGMA
from geometry.sfm.features import THREADS

TiedBy = Literal["tracks", "SIFT"]
"""What ties frames together."""
INFLATION: dict[TiedBy, float] = {"tracks": 4.5, "SIFT": 3.0}
"""Factor on the formal standard deviations; what it gives is at `AdjustmentErrors`."""


@dataclass(frozen=True, kw_only=True)
class AdjustmentErrors:
    """What an adjusted model may have wrong.

    The formal covariance is scaled by the observed reprojection error and inflated: it takes
    features for independent; those of one track share their error, and a tracked one is seen in
    more frames than one of SIFT. NEES per degree of freedom is 0.3 to 2.0 on rendered orbits by
    tracks, 0.7 to 4.2 by SIFT, and 5 on surveyed photos with a known camera (`python -m
    benchmarks.sfm` prints it). What a wrong camera model does to all poses together, a principal
    point off the centre above all, is not in it.

    Attributes:
        model: The reconstruction.
        estimate: Its covariance for unit pixel noise; None where the problem is too weak for one.
        residual_sigma_px: Robust standard deviation of a coordinate of the reprojection error.
        inflation: Factor on the formal standard deviations, beside that one.
    """

    model: pycolmap.Reconstruction
    estimate: pycolmap.BACovariance | None
    residual_sigma_px: float
    inflation: float

    @classmethod
    def of(cls, model: pycolmap.Reconstruction, *, refined_camera: bool, tied_by: TiedBy) -> Self:
        """Of a model.

        Args:
            model: An adjusted reconstruction.
            refined_camera: The intrinsics were estimated too, and share the uncertainty.
            tied_by: What the adjusted features are.
        """
        return cls(
            model=model,
            estimate=estimate_covariance(model, refined_camera=refined_camera),
            residual_sigma_px=residual_sigma_px(model),
            inflation=INFLATION[tied_by],
        )

    def pose_covariances(self, image_ids: list[int]) -> FloatArray | None:
        """Covariances of N poses.

        Args:
            image_ids: The images asked for, all registered.

        Returns:
            (N, 6, 6) of world_from_cam, [rotation (rad), translation (model units)], right tangent;
            None where the problem is too weak for a covariance.
        """
        joint = formal_covariance(self.model, image_ids, self.estimate)
        if joint is None:
            return None
        n = len(image_ids)
        blocks = joint.reshape(n, 6, n, 6)[np.arange(n), :, np.arange(n), :]
        return np.asarray(blocks * (self.inflation * self.residual_sigma_px) ** 2)

    @property
    def focal_sigma_px(self) -> float | None:
        """Standard deviation of an estimated focal length, px, inflated as the poses are.

        None where it was given, or the problem is too weak for one.
        """
        (camera,) = self.model.cameras.values()
        joint = None if self.estimate is None else self.estimate.get_other_params_cov(camera.params)
        if joint is None or not np.isfinite(joint).all():
            return None
        return float(np.sqrt(joint[0, 0]) * self.inflation * self.residual_sigma_px)


def formal_covariance(
    model: pycolmap.Reconstruction, image_ids: list[int], estimate: pycolmap.BACovariance | None
) -> FloatArray | None:
    """(6N, 6N) joint covariance for unit pixel noise, gauge freedom removed, gtsam's tangent."""
    gauge_fixed = None if estimate is None else _gauge_fixed_covariance(model, image_ids, estimate)
    if gauge_fixed is None or not np.isfinite(gauge_fixed).all():
        return None
    poses = [model.image(i).cam_from_world() for i in image_ids]
    translations = np.array([pose.translation for pose in poses])
    rotations = np.array([pose.rotation.matrix() for pose in poses])
    to_gtsam = _block_diagonal(gtsam_from_colmap_tangent(translations))
    projector = gauge_projector(rotations, translations) @ to_gtsam
    return np.asarray(projector @ gauge_fixed @ projector.T)


def gtsam_from_colmap_tangent(translations: FloatArray) -> FloatArray:
    """(N, 6, 6) Jacobians ``[[2 I, 0], [2 [t]x, I]]``.

    COLMAP perturbs cam_from_world by half angles and adds to its translation; gtsam perturbs
    world_from_cam on the right. The common sign is left out.

    Args:
        translations: (N, 3) cam_from_world.
    """
    jacobians = np.tile(np.eye(6), (len(translations), 1, 1))
    jacobians[:, :3, :3] *= 2
    jacobians[:, 3:, :3] = 2 * skew_matrices(translations)
    return jacobians


def gauge_projector(rotations: FloatArray, translations: FloatArray) -> FloatArray:
    """(6N, 6N) takes the best similarity transform of all cameras out of pose errors.

    Rotations count with the spread of the cameras as their lever, so that the answer does not
    depend on the unit of length.

    Args:
        rotations: (N, 3, 3) cam_from_world.
        translations: (N, 3) cam_from_world.
    """
    n = len(rotations)
    centers = -np.einsum("nji,nj->ni", rotations, translations)
    centers = centers - centers.mean(axis=0)
    moves = np.zeros((n, 6, 7))
    moves[:, :3, :3] = rotations
    moves[:, 3:, :3] = -rotations @ skew_matrices(centers)
    moves[:, 3:, 3:6] = rotations
    moves[:, 3:, 6] = np.einsum("nij,nj->ni", rotations, centers)
    gauge = moves.reshape(6 * n, 7)
    lever = float(np.sqrt((centers**2).sum(axis=1).mean()))
    weights = np.tile(np.repeat([lever**2, 1.0], 3), n)
    weighted = gauge * weights[:, None]
    return np.asarray(np.eye(6 * n) - gauge @ np.linalg.solve(gauge.T @ weighted, weighted.T))


def skew_matrices(vectors: FloatArray) -> FloatArray:
    """(N, 3, 3) cross-product matrices of (N, 3) vectors."""
    x, y, z = vectors.T
    zero = np.zeros_like(x)
    return np.stack([zero, -z, y, z, zero, -x, -y, x, zero], axis=-1).reshape(-1, 3, 3)


def residual_sigma_px(model: pycolmap.Reconstruction) -> float:
    """Robust standard deviation of one coordinate of the reprojection error, px."""
    world = {number: point.xyz for number, point in model.points3D.items()}
    residuals = []
    for image_id in model.reg_image_ids():
        image = model.image(image_id)
        seen = image.get_observation_points2D()
        points = np.array([world[point.point3D_id] for point in seen]).reshape(-1, 3)
        pose = image.cam_from_world()
        in_cam = points @ pose.rotation.matrix().T + pose.translation
        camera = model.camera(image.camera_id)
        measured = np.array([point.xy for point in seen]).reshape(-1, 2)
        residuals.append(np.asarray(camera.img_from_cam(in_cam)) - measured)
    stacked = np.concatenate(residuals)
    unknowns = 6 * model.num_reg_images() + 3 * model.num_points3D()
    lost = np.sqrt(stacked.size / max(stacked.size - unknowns, 1))
    return float(MAD_TO_SIGMA * np.median(np.abs(stacked)) * lost)


def estimate_covariance(
    model: pycolmap.Reconstruction, *, refined_camera: bool
) -> pycolmap.BACovariance | None:
    """Covariance for unit pixel noise, where the gauge holds two cameras."""
    options = pycolmap.BundleAdjustmentOptions()
    options.print_summary = False
    options.refine_focal_length = refined_camera
    options.refine_extra_params = refined_camera
    options.ceres.solver_options.num_threads = THREADS
    config = pycolmap.BundleAdjustmentConfig()
    for image_id in model.reg_image_ids():
        config.add_image(image_id)
    config.fix_gauge(pycolmap.BundleAdjustmentGauge.TWO_CAMS_FROM_WORLD)
    adjuster = pycolmap.create_default_ceres_bundle_adjuster(options, config, model)
    wanted = pycolmap.BACovarianceOptions()
    params = pycolmap.BACovarianceOptionsParams
    wanted.params = params.ALL if refined_camera else params.POSES
    return pycolmap.estimate_ba_covariance(wanted, model, adjuster)


def _gauge_fixed_covariance(
    model: pycolmap.Reconstruction, image_ids: list[int], estimate: pycolmap.BACovariance
) -> FloatArray | None:
    """(6N, 6N) in COLMAP's tangent, zero where the gauge holds two cameras."""
    blocks = {i: estimate.get_cam_cov_from_world(i) for i in image_ids}
    free = _free_rows(model, blocks)
    if free is None:
        return None
    n = len(image_ids)
    joint = np.zeros((6 * n, 6 * n))
    for a, first in enumerate(image_ids):
        for b, second in enumerate(image_ids[: a + 1]):
            rows, columns = 6 * a + free[first], 6 * b + free[second]
            if len(rows) and len(columns):
                cross = estimate.get_cam_cross_cov_from_world(first, second)
                block = np.asarray(blocks[first] if a == b else cross, dtype=float)
                joint[np.ix_(rows, columns)] = block
                joint[np.ix_(columns, rows)] = block.T
    return joint


def _free_rows(
    model: pycolmap.Reconstruction, blocks: dict[int, FloatArray | None]
) -> dict[int, IntArray] | None:
    """The tangent directions of each camera that the gauge leaves free.

    COLMAP holds the whole pose of one camera, and of a second one the component of its translation
    along which cam1_from_cam2 is longest. None where no camera of `blocks` is held.
    """
    held = next((i for i, block in blocks.items() if block is None), None)
    if held is None:
        return None
    free = {i: np.arange(6) for i in blocks}
    free[held] = np.arange(0)
    for image_id, block in blocks.items():
        if block is not None and len(block) == 5:
            held_from_world = model.image(held).cam_from_world()
            held_from_cam = held_from_world * model.image(image_id).cam_from_world().inverse()
            longest = int(np.argmax(np.abs(held_from_cam.translation)))
            free[image_id] = np.delete(np.arange(6), 3 + longest)
    return free


def _block_diagonal(blocks: FloatArray) -> FloatArray:
    n = len(blocks)
    joint = np.zeros((n, 6, n, 6))
    joint[np.arange(n), :, np.arange(n), :] = blocks
    return joint.reshape(6 * n, 6 * n)
