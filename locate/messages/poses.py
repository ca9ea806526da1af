"""Where the camera was at any stamp: poses that come late, early or out of order."""

from bisect import bisect_left, insort
from collections.abc import Sequence
from dataclasses import dataclass, replace
from operator import attrgetter

import numpy as np
from scipy.spatial.transform import Rotation

from geometry.arrays import FloatArray
from geometry.camera import Camera
from geometry.errors import BadInputError
from geometry.trajectory import FARTHEST, MOST_VARIANCE, Trajectory
from locate.messages.stamps import NS_PER_S, StampGate

RIGID_TOLERANCE = 1e-3
"""Largest error of an entry of R^T R that float32 messages and rounded files need (chosen)."""
MOST_POSES = 30_000
"""Kept in a buffer: 30 s at 1 kHz (chosen)."""
UNKNOWN_COVARIANCE = np.full((6, 6), np.nan)
"""Of poses that come without one."""

_stamp = attrgetter("stamp_ns")


@dataclass(frozen=True, kw_only=True)
class StampedPose:
    """Where the camera was at one moment.

    Attributes:
        stamp_ns: When, ns, on the clock of the images.
        world_from_cam: (4, 4) rigid transform, metres; the camera looks along its z, y is down.
        covariance: (6, 6) of `world_from_cam` in gtsam's order [rotation (rad), translation],
            right tangent; NaN where unknown.

    Raises:
        BadInputError: Not a rigid transform of finite numbers, or not a covariance.
    """

    stamp_ns: int
    world_from_cam: FloatArray
    covariance: FloatArray

    def __post_init__(self) -> None:
        pose, covariance = self.world_from_cam, self.covariance
        if pose.shape != (4, 4) or covariance.shape != (6, 6):
            raise BadInputError(
                f"pose {pose.shape} with covariance {covariance.shape}: give (4, 4) and (6, 6)"
            )
        rotation = pose[:3, :3]
        turned = np.isfinite(pose).all() and np.abs(rotation).max() < 2  # squares may overflow
        if not turned or (
            np.abs(rotation.T @ rotation - np.eye(3)).max() > RIGID_TOLERANCE
            or np.linalg.det(rotation) < 0
            or (pose[3] != [0, 0, 0, 1]).any()
        ):
            raise BadInputError("pose is not a rotation and a translation of finite numbers")
        if np.abs(pose[:3, 3]).max() > FARTHEST:
            raise BadInputError(f"pose is over {FARTHEST:g} m from the origin")
        if np.isinf(covariance).any() or (np.diag(covariance) < 0).any():
            raise BadInputError("pose covariance is infinite or has a negative variance")
        if (np.abs(covariance) > MOST_VARIANCE).any():
            raise BadInputError(f"pose covariance is over {MOST_VARIANCE:g} m squared")

    @property
    def center_in_world(self) -> FloatArray:
        """(3,) camera centre."""
        return self.world_from_cam[:3, 3]


class PoseBuffer:
    """The poses of the last moments, sorted by stamp, interpolated on demand.

    One wrong stamp is left out; where the clock went back, the poses before are forgotten.

    Args:
        kept_ns: Poses older than the newest by more than this are forgotten.
        max_gap_ns: Across a longer gap nothing is interpolated.
        most: Of more poses the oldest are forgotten.
    """

    def __init__(
        self,
        *,
        kept_ns: int = 30 * NS_PER_S,
        max_gap_ns: int = NS_PER_S // 2,
        most: int = MOST_POSES,
    ) -> None:
        self._poses: list[StampedPose] = []
        self._most = most
        self._kept_ns = kept_ns
        self._max_gap_ns = max_gap_ns
        self._gate: StampGate[StampedPose] = StampGate()

    @property
    def left_out(self) -> int:
        """How many poses had a wrong stamp."""
        return self._gate.left_out

    @property
    def newest_ns(self) -> int | None:
        """The latest stamp, None before the first."""
        return self._gate.newest_ns

    def __len__(self) -> int:
        return len(self._poses)

    def add(self, pose: StampedPose) -> bool:
        """Takes a pose; one of the same stamp is replaced.

        Returns:
            Whether the clock went back.
        """
        admitted = self._gate.admit(pose.stamp_ns, pose)
        if admitted.went_back:
            self._poses.clear()
        for one in admitted.messages:
            self._insert(one)
        return admitted.went_back

    def _insert(self, pose: StampedPose) -> None:
        place = bisect_left(self._poses, pose.stamp_ns, key=_stamp)
        if place < len(self._poses) and self._poses[place].stamp_ns == pose.stamp_ns:
            self._poses[place] = pose
        else:
            insort(self._poses, pose, key=_stamp)
        oldest_ns = self._poses[-1].stamp_ns - self._kept_ns
        old = bisect_left(self._poses, oldest_ns, key=_stamp)
        del self._poses[: max(old, len(self._poses) - self._most)]

    def interpolate_at(self, stamp_ns: int) -> StampedPose | None:
        """The pose at `stamp_ns`, or None where no two poses near enough stand around it (yet).

        The rotation follows the great arc, the translation the line, the covariance the line too:
        the errors of neighbouring poses are taken to be one error.
        """
        place = bisect_left(self._poses, stamp_ns, key=_stamp)
        if place == len(self._poses):
            return None
        after = self._poses[place]
        if after.stamp_ns == stamp_ns:
            return after
        if place == 0:
            return None
        before = self._poses[place - 1]
        gap_ns = after.stamp_ns - before.stamp_ns
        if gap_ns > self._max_gap_ns:
            return None
        return _interpolate(before, after, (stamp_ns - before.stamp_ns) / gap_ns, stamp_ns)


def _interpolate(
    before: StampedPose, after: StampedPose, share: float, stamp_ns: int
) -> StampedPose:
    start = Rotation.from_matrix(before.world_from_cam[:3, :3])
    turn = (start.inv() * Rotation.from_matrix(after.world_from_cam[:3, :3])).as_rotvec()
    pose = before.world_from_cam + share * (after.world_from_cam - before.world_from_cam)
    pose[:3, :3] = (start * Rotation.from_rotvec(share * turn)).as_matrix()
    covariance = before.covariance + share * (after.covariance - before.covariance)
    return replace(before, stamp_ns=stamp_ns, world_from_cam=pose, covariance=covariance)


def trajectory_from_poses(
    poses: Sequence[StampedPose], numbers: Sequence[int], camera: Camera
) -> Trajectory:
    """The poses as a metric trajectory whose world has Z up.

    Args:
        poses: N of them, by ascending number.
        numbers: N key-frame numbers.
        camera: That took every frame.
    """
    moved = np.stack([pose.world_from_cam for pose in poses])
    rotations = moved[:, :3, :3].transpose(0, 2, 1)
    covariances = np.stack([pose.covariance for pose in poses])
    start_ns = poses[0].stamp_ns
    return Trajectory(
        camera=camera,
        indices=np.array(numbers, dtype=np.int64),
        times_s=np.array([(pose.stamp_ns - start_ns) / NS_PER_S for pose in poses]),
        rotations=rotations,
        translations=-np.einsum("nij,nj->ni", rotations, moved[:, :3, 3]),
        covariances=None if np.isnan(covariances).all() else covariances,
        metric=True,
        gravity=True,
    )
