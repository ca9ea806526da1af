"""How a robot's frames hang together, and where that puts the camera."""

from dataclasses import dataclass
from typing import Any, Literal, get_args

import numpy as np

from geometry.arrays import FloatArray
from geometry.errors import BadInputError
from locate.messages.codec import read_stamp_ns
from locate.messages.poses import UNKNOWN_COVARIANCE, StampedPose
from locate.messages.transforms import (
    TransformTree,
    camera_covariance,
    pose_matrix,
    tangent_covariance,
)

PoseSource = Literal["tf", "odometry", "pose"]


@dataclass(frozen=True, kw_only=True)
class Wiring:
    """How a robot's frames and poses hang together.

    Attributes:
        world_frame: Frame of the map, Z up.
        camera_frame: Optical frame of the camera; empty takes it from the images.
        body_frame: Frame whose pose comes in; empty takes the odometry's child frame, and for
            poses without one the camera itself.
        pose_source: Where poses come from.
        pose_sigma_m: Position sigma of poses that come without covariance, m; 0 is unknown.
        pose_sigma_deg: Their rotation sigma; 0 is unknown.
        rectified: The images are rectified.

    Raises:
        BadInputError: The pose source is not known.
    """

    world_frame: str = "map"
    camera_frame: str = ""
    body_frame: str = ""
    pose_source: PoseSource = "tf"
    pose_sigma_m: float = 0.0
    pose_sigma_deg: float = 0.0
    rectified: bool = False

    def __post_init__(self) -> None:
        known = get_args(PoseSource)
        if self.pose_source not in known:
            raise BadInputError(f"pose_source is {self.pose_source!r}: use {', '.join(known)}")

    @property
    def stated_covariance(self) -> FloatArray:
        """(6, 6) of poses that come without one; NaN where it is unknown."""
        if self.pose_sigma_m <= 0 or self.pose_sigma_deg <= 0:
            return UNKNOWN_COVARIANCE
        sigmas = np.repeat([np.radians(self.pose_sigma_deg), self.pose_sigma_m], 3)
        return np.diag(sigmas**2)


class PoseResolver:
    """Finds where the camera was, by a robot's messages.

    Args:
        wiring: How the robot's frames hang together.

    Attributes:
        tree: The transforms that TF has sent.
        camera_frame: Of the images; empty until one has come.
    """

    def __init__(self, wiring: Wiring) -> None:
        self.tree = TransformTree()
        self.camera_frame = wiring.camera_frame
        self._wiring = wiring

    def pose_from_tf(self, stamp: int) -> StampedPose | None:
        """The pose at `stamp` ns by TF, or None where it does not hold it (yet)."""
        found = self.tree.find(self._wiring.world_frame, self.camera_frame, stamp)
        if found is None:
            return None
        covariance = self._wiring.stated_covariance
        return StampedPose(stamp_ns=stamp, world_from_cam=found, covariance=covariance)

    def pose_from_message(self, message: Any) -> StampedPose:
        """The pose by an `Odometry`, `PoseWithCovarianceStamped` or `PoseStamped` of the body.

        Raises:
            BadInputError: It holds no pose, or TF does not hold how the camera is mounted.
        """
        stamp = read_stamp_ns(message.header)
        body = self._wiring.body_frame or getattr(message, "child_frame_id", "")
        bare = not hasattr(message.pose, "pose")
        pose = message.pose if bare else message.pose.pose
        world_from_body = pose_matrix(pose.position, pose.orientation)
        mount = self.tree.find(body, self.camera_frame, stamp) if body else np.eye(4)
        if mount is None:
            raise BadInputError(f"TF does not say where {self.camera_frame!r} is in {body!r}")
        given = np.zeros(36) if bare else message.pose.covariance
        covariance = tangent_covariance(world_from_body, given)
        if np.isnan(covariance).any():
            covariance = self._wiring.stated_covariance
        return StampedPose(
            stamp_ns=stamp,
            world_from_cam=world_from_body @ mount,
            covariance=camera_covariance(mount, covariance),
        )
