"""Pose messages converted to poses, and a small buffer of the transforms between frames."""

from collections.abc import Iterable
from typing import Any

import gtsam
import numpy as np
from scipy.spatial.transform import Rotation

from geometry.arrays import FloatArray
from geometry.errors import BadInputError
from geometry.trajectory import FARTHEST
from locate.messages.codec import read_stamp_ns
from locate.messages.poses import UNKNOWN_COVARIANCE, PoseBuffer, StampedPose

MOST_KNOWN, MOST_POSES = 512, 4096
"""Frames that are known, and moments of each, at most: a flood of TF must not fill the memory
(chosen)."""
MOST_FRAMES = 64
"""Frames from one to the root, at most: a loop of frames ends there (chosen)."""


def pose_matrix(translation: Any, rotation: Any) -> FloatArray:
    """(4, 4) of a message's translation (or position) and quaternion.

    Raises:
        BadInputError: The quaternion is zero or something is not finite.
    """
    quaternion = np.array([rotation.x, rotation.y, rotation.z, rotation.w], dtype=float)
    shift = np.array([translation.x, translation.y, translation.z], dtype=float)
    size = np.abs(quaternion).max()
    if not np.isfinite([*quaternion, *shift]).all() or not 1e-6 < size < 1e6:
        raise BadInputError("pose has no rotation, or numbers that are not finite")
    if np.abs(shift).max() > FARTHEST:
        raise BadInputError(f"pose is over {FARTHEST:g} m from the origin")
    matrix = np.eye(4)
    matrix[:3, :3] = Rotation.from_quat(quaternion).as_matrix()
    matrix[:3, 3] = shift
    return matrix


def tangent_covariance(world_from_body: FloatArray, ros_covariance: Any) -> FloatArray:
    """(6, 6) in gtsam's right tangent from the covariance of a `PoseWithCovariance`.

    There it is row-major in the order x, y, z, rotation about the world's X, Y, Z. All zeros, or
    a negative variance, mean unknown: NaN.

    Raises:
        BadInputError: It has another number of entries.
    """
    given = np.array(ros_covariance, dtype=float)
    if given.shape != (36,):
        raise BadInputError(f"pose covariance has {given.size} numbers, expected 36")
    given = given.reshape(6, 6)
    if not np.isfinite(given).all() or (np.diag(given) < 0).any() or not given.any():
        return UNKNOWN_COVARIANCE
    swapped = np.roll(given, (3, 3), axis=(0, 1))
    body_from_world = np.kron(np.eye(2), world_from_body[:3, :3].T)
    return np.asarray(body_from_world @ swapped @ body_from_world.T)


def camera_covariance(body_from_cam: FloatArray, covariance: FloatArray) -> FloatArray:
    """(6, 6) of world_from_cam from that of world_from_body; the mounting is taken as exact."""
    moved = np.asarray(gtsam.Pose3(np.linalg.inv(body_from_cam)).AdjointMap())
    return np.asarray(moved @ covariance @ moved.T)


def ros_covariance(world_from_body: FloatArray, covariance: FloatArray) -> FloatArray:
    """(36,) the inverse of `tangent_covariance`."""
    world_from_tangent = np.kron(np.eye(2), world_from_body[:3, :3])
    turned = world_from_tangent @ covariance @ world_from_tangent.T
    return np.asarray(np.roll(turned, (3, 3), axis=(0, 1)).ravel())


class TransformTree:
    """The transforms between a robot's frames over time, as TF sends them.

    Attributes:
        refused: How many could not be taken.
        last_refusal: Why the latest of them could not.
    """

    def __init__(self) -> None:
        self.refused = 0
        self.last_refusal: BadInputError | None = None
        self._parents: dict[str, str] = {}
        self._fixed: dict[str, FloatArray] = {}
        self._moving: dict[str, PoseBuffer] = {}

    def add(self, transforms: Iterable[Any], *, static: bool) -> list[int]:
        """Takes `geometry_msgs/TransformStamped`; those that cannot be are counted.

        Returns:
            The stamps of those taken, ns.
        """
        stamps = []
        for one in transforms:
            try:
                stamps.append(self._add_one(one, static=static))
            except BadInputError as error:
                self.refused += 1
                self.last_refusal = error
        return stamps

    def _add_one(self, one: Any, *, static: bool) -> int:
        child, parent = _plain_name(one.child_frame_id), _plain_name(one.header.frame_id)
        if child not in self._parents and len(self._parents) >= MOST_KNOWN:
            raise BadInputError(f"TF names over {MOST_KNOWN} frames; {child!r} is left out")
        matrix = pose_matrix(one.transform.translation, one.transform.rotation)
        stamp_ns = read_stamp_ns(one.header)
        if static:
            self._fixed[child] = matrix
        else:
            pose = StampedPose(
                stamp_ns=stamp_ns, world_from_cam=matrix, covariance=UNKNOWN_COVARIANCE
            )
            self._moving.setdefault(child, PoseBuffer(most=MOST_POSES)).add(pose)
        self._parents[child] = parent
        return stamp_ns

    def find(self, target: str, source: str, stamp: int) -> FloatArray | None:
        """(4, 4) target_from_source at `stamp` ns, None where TF does not hold it (yet)."""
        up_source = self._path_to_root(_plain_name(source))
        up_target = self._path_to_root(_plain_name(target))
        meeting = next((frame for frame in up_source if frame in up_target), None)
        if meeting is None:
            return None
        from_source = self._chain_transforms(up_source[: up_source.index(meeting)], stamp)
        from_target = self._chain_transforms(up_target[: up_target.index(meeting)], stamp)
        if from_source is None or from_target is None:
            return None
        return np.asarray(np.linalg.inv(from_target) @ from_source)

    def _path_to_root(self, frame: str) -> list[str]:
        path = [frame]
        while (parent := self._parents.get(path[-1])) is not None and len(path) < MOST_FRAMES:
            path.append(parent)
        return path

    def _chain_transforms(self, frames: list[str], stamp: int) -> FloatArray | None:
        """The product of the transforms of `frames` in their parents."""
        total = np.eye(4)
        for frame in frames:
            step = self._fixed.get(frame)
            if step is None:
                pose = self._moving[frame].interpolate_at(stamp)
                if pose is None:
                    return None
                step = pose.world_from_cam
            total = step @ total
        return total


def _plain_name(frame: str) -> str:
    """Older software writes a slash in front."""
    return frame.removeprefix("/")
