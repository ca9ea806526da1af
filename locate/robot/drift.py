"""The part of the pose errors that all views of a window share: odometry that has drifted."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Self

import gtsam
import numpy as np

from geometry.arrays import FloatArray
from locate.messages.poses import StampedPose

LEAST_OWN_SHARE = 0.05
"""Share of a pose's covariance that is never taken for shared (chosen)."""


@dataclass(frozen=True, kw_only=True)
class SharedError:
    """An error of the world frame itself, as the most certain pose of a window states it.

    The drift of an odometry until a window began moves everything in the window; averaging over
    views must not shrink it. Each view keeps its covariance less that part, at least
    `LEAST_OWN_SHARE` of it.

    Attributes:
        pose: The pose with the smallest position covariance; None where none is known.
    """

    pose: StampedPose | None

    @classmethod
    def from_poses(cls, poses: Sequence[StampedPose]) -> Self:
        """The error that these poses share."""
        known = [pose for pose in poses if np.isfinite(pose.covariance).all()]
        most_certain = min(
            known, key=lambda pose: float(np.trace(pose.covariance[3:, 3:])), default=None
        )
        return cls(pose=most_certain)

    def remove_from(self, poses: Sequence[StampedPose]) -> list[StampedPose]:
        """The poses with what is left of their covariances."""
        return [replace(pose, covariance=self._own_covariance(pose)) for pose in poses]

    def _own_covariance(self, pose: StampedPose) -> FloatArray:
        if self.pose is None or not np.isfinite(pose.covariance).all():
            return pose.covariance
        between = np.linalg.inv(pose.world_from_cam) @ self.pose.world_from_cam
        moved = np.asarray(gtsam.Pose3(between).AdjointMap())
        shared = moved @ self.pose.covariance @ moved.T
        return _remaining_covariance(pose.covariance, shared)

    def covariance_at(self, point_in_world: FloatArray) -> FloatArray:
        """(3, 3) covariance that the shared error gives a point of the world, m squared."""
        if self.pose is None:
            return np.zeros((3, 3))
        rotation = self.pose.world_from_cam[:3, :3]
        x, y, z = rotation.T @ (point_in_world - self.pose.center_in_world)
        cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
        jacobian = rotation @ np.hstack([-cross, np.eye(3)])
        return np.asarray((1 - LEAST_OWN_SHARE) * jacobian @ self.pose.covariance @ jacobian.T)


def _remaining_covariance(whole: FloatArray, shared: FloatArray) -> FloatArray:
    """`whole - shared`, kept between `LEAST_OWN_SHARE` and all of `whole` in every direction."""
    values, vectors = np.linalg.eigh(whole)
    root = vectors * np.sqrt(np.maximum(values, 1e-18))
    unrooted = vectors / np.sqrt(np.maximum(values, 1e-18))
    share, axes = np.linalg.eigh(np.eye(6) - unrooted.T @ shared @ unrooted)
    return np.asarray(root @ axes @ np.diag(share.clip(LEAST_OWN_SHARE, 1)) @ axes.T @ root.T)
