"""Pose covariances against gtsam on the same problem, and their independence of the gauge."""

from types import SimpleNamespace

import gtsam
import numpy as np
import pycolmap
import pytest

from geometry.sfm.covariance import (
    AdjustmentErrors,
    estimate_covariance,
    formal_covariance,
    gauge_projector,
    gtsam_from_colmap_tangent,
)

X, P = gtsam.symbol_shorthand.X, gtsam.symbol_shorthand.P


def synthetic_model(seed: int) -> tuple[pycolmap.Reconstruction, list[int]]:
    options = pycolmap.SyntheticDatasetOptions()
    options.num_rigs = 1
    options.num_frames_per_rig = 6
    options.num_points3D = 60
    options.camera_model_id = pycolmap.CameraModelId.SIMPLE_PINHOLE
    options.camera_params = [1280, 512, 384]
    pycolmap.set_random_seed(seed)
    model = pycolmap.synthesize_dataset(options)
    return model, sorted(model.reg_image_ids())


def gtsam_marginals(model: pycolmap.Reconstruction, ids: list[int]) -> np.ndarray:
    """(6N, 6N) with unit pixel noise; one camera and one distance hold the gauge."""
    graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
    camera = next(iter(model.cameras.values()))
    focal, cx, cy = camera.params
    calibration = gtsam.Cal3_S2(focal, focal, 0, cx, cy)
    noise = gtsam.noiseModel.Isotropic.Sigma(2, 1.0)
    for row, image_id in enumerate(ids):
        world_from_cam = model.image(image_id).cam_from_world().inverse()
        rotation = gtsam.Rot3(world_from_cam.rotation.matrix())
        values.insert(X(row), gtsam.Pose3(rotation, world_from_cam.translation))
    tight = gtsam.noiseModel.Isotropic.Sigma(6, 1e-3)
    graph.add(gtsam.PriorFactorPose3(X(0), values.atPose3(X(0)), tight))
    for point_id, point in model.points3D.items():
        values.insert(P(point_id), point.xyz)
        for element in point.track.elements:
            pixel = model.image(element.image_id).points2D[element.point2D_idx].xy
            key = X(ids.index(element.image_id))
            graph.add(
                gtsam.GenericProjectionFactorCal3_S2(pixel, noise, key, P(point_id), calibration)
            )
    point_id, point = next(iter(model.points3D.items()))
    distance = float(np.linalg.norm(point.xyz - model.image(ids[0]).projection_center()))
    scale = gtsam.noiseModel.Isotropic.Sigma(1, 1e-3)
    graph.add(gtsam.RangeFactor3D(X(0), P(point_id), distance, scale))
    keys = gtsam.KeyVector([X(row) for row in range(len(ids))])
    joint = gtsam.Marginals(graph, values).jointMarginalCovariance(keys)
    blocks = [[joint.at(a, b) for b in keys] for a in keys]
    return np.block(blocks)


def gauge_free(model: pycolmap.Reconstruction, ids: list[int], joint: np.ndarray) -> np.ndarray:
    poses = [model.image(i).cam_from_world() for i in ids]
    projector = gauge_projector(
        np.array([p.rotation.matrix() for p in poses]), np.array([p.translation for p in poses])
    )
    return projector @ joint @ projector.T


@pytest.mark.parametrize("seed", [1, 2, 3, 10])
def test_same_as_gtsam(seed: int) -> None:
    model, ids = synthetic_model(seed)
    ours = formal_covariance(model, ids, estimate_covariance(model, refined_camera=False))
    theirs = gauge_free(model, ids, gtsam_marginals(model, ids))
    assert ours is not None
    np.testing.assert_allclose(ours, theirs, atol=1e-6 * np.abs(theirs).max())


def test_tangent_conversion_matters() -> None:
    conversion = gtsam_from_colmap_tangent(np.array([[0.0, 0.0, 5.0]]))[0]
    np.testing.assert_array_equal(conversion[:3, :3], 2 * np.eye(3))
    np.testing.assert_array_equal(
        conversion[3:, :3] @ [1, 0, 0], 2 * np.cross([0, 0, 5], [1, 0, 0])
    )


def test_every_pose_has_a_covariance() -> None:
    model, ids = synthetic_model(4)
    noise = pycolmap.SyntheticNoiseOptions()
    noise.point2D_stddev = 0.5
    pycolmap.synthesize_noise(noise, model)
    errors = AdjustmentErrors.of(model, refined_camera=True, tied_by="SIFT")
    covariances = errors.pose_covariances(ids)
    assert covariances is not None
    assert covariances.shape == (6, 6, 6)
    assert np.isfinite(covariances).all()
    assert (np.linalg.eigvalsh(covariances) > 0).all()


def test_no_covariance_where_the_gauge_holds_no_camera(monkeypatch: pytest.MonkeyPatch) -> None:
    model, ids = synthetic_model(4)
    whole = SimpleNamespace(
        get_cam_cov_from_world=lambda _: np.eye(6),
        get_cam_cross_cov_from_world=lambda _a, _b: np.zeros((6, 6)),
    )
    monkeypatch.setattr(pycolmap, "estimate_ba_covariance", lambda *_: whole)
    errors = AdjustmentErrors.of(model, refined_camera=False, tied_by="SIFT")
    assert errors.pose_covariances(ids) is None


def test_gauge_projector_removes_similarities_and_nothing_else() -> None:
    random = np.random.default_rng(0)
    model, ids = synthetic_model(5)
    poses = [model.image(i).cam_from_world() for i in ids]
    rotations = np.array([p.rotation.matrix() for p in poses])
    translations = np.array([p.translation for p in poses])
    projector = gauge_projector(rotations, translations)
    centers = -np.einsum("nji,nj->ni", rotations, translations)
    turn, shift, growth = random.normal(size=3), random.normal(size=3), 0.3
    moved = np.cross(turn, centers) + shift + growth * centers
    errors = np.concatenate(
        [rotations @ turn, np.einsum("nij,nj->ni", rotations, moved)], axis=1
    ).ravel()
    np.testing.assert_allclose(projector @ errors, 0, atol=1e-9)
    np.testing.assert_allclose(projector @ projector, projector, atol=1e-9)
    assert np.linalg.matrix_rank(projector) == 6 * len(ids) - 7
