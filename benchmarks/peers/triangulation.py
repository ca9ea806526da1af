"""A point of each view's mask, triangulated: every pair of views by OpenCV, the best refined."""

from itertools import combinations

import cv2
import numpy as np
from scipy.optimize import least_squares

from benchmarks.peers.blobs import SourceEstimate
from geometry.arrays import FloatArray, IntArray
from geometry.trajectory import Trajectory

INLIER_PX = 8.0
FEWEST_VIEWS = 3


def triangulate_marks(trajectory: Trajectory, pixels: FloatArray) -> SourceEstimate | None:
    """The point that most views agree on; None where fewer than three do.

    Args:
        trajectory: V poses.
        pixels: (V, 2) a point in each view; NaN where it has none.
    """
    rows = np.flatnonzero(np.isfinite(pixels).all(axis=1)).astype(np.int64)
    projections = {i: _projection(trajectory, i) for i in rows.tolist()}
    best: FloatArray = np.empty(0)
    agreeing = rows[:0]
    for i, j in combinations(projections, 2):
        found = cv2.triangulatePoints(projections[i], projections[j], pixels[i], pixels[j])
        point = found[:3, 0] / found[3, 0]
        error_px = np.linalg.norm(_residuals(trajectory, rows, pixels, point), axis=1)
        near = rows[error_px < INLIER_PX]
        if len(near) > len(agreeing):
            best, agreeing = point, near
    if len(agreeing) < FEWEST_VIEWS:
        return None

    def errors_px(point: FloatArray) -> FloatArray:
        return _residuals(trajectory, agreeing, pixels, point).ravel()

    fit = least_squares(errors_px, best)
    jacobian = np.asarray(fit.jac)
    freedom = max(1, len(fit.fun) - 3)
    variance = float((fit.fun**2).sum()) / freedom
    return SourceEstimate(source=fit.x, covariance=variance * np.linalg.inv(jacobian.T @ jacobian))


def _projection(trajectory: Trajectory, i: int) -> FloatArray:
    pose = np.column_stack([trajectory.rotations[i], trajectory.translations[i]])
    return np.asarray(trajectory.camera.matrix @ pose)


def _residuals(
    trajectory: Trajectory, rows: IntArray, pixels: FloatArray, point: FloatArray
) -> FloatArray:
    """(R, 2) px; far off for a point behind a camera."""
    in_cam = trajectory.rotations[rows] @ point + trajectory.translations[rows]
    seen = in_cam @ trajectory.camera.matrix.T
    depth = seen[:, 2:]
    away = np.where(depth > 0, seen[:, :2] / np.where(depth > 0, depth, 1) - pixels[rows], 1e4)
    return np.asarray(away)
