"""Which images become key frames, and where the camera was when it took them."""

from dataclasses import dataclass, field

import cv2
import numpy as np

from detect.warp import sample
from geometry.arrays import GreyImage
from geometry.camera import Camera
from geometry.errors import BadInputError
from locate.messages.poses import PoseBuffer, StampedPose
from locate.messages.stamps import NS_PER_S, StampGate
from locate.recording.images import distortion_map
from locate.robot.settings import LocatorSettings
from locate.robot.window import FrameWindow, WindowFrame

LEAST_JUMP_M = 0.5
"""Shorter steps between two poses are never a jump, however little time is between (chosen)."""


@dataclass(kw_only=True)
class LocatorCounts:
    """What became of everything that was fed.

    Attributes:
        images: Fed.
        poses: Fed.
        passed_over: Images too near to the last key frame to add anything.
        unposed: Images whose pose did not come in time.
        misdated: Images and poses that were left out: their stamp is far from those around it.
        key_frames: Images kept.
        looked_at: Key frames that the detector has processed.
        dropped: Key frames that it had no time for.
        jumps: How often the poses jumped, or the clock went back, and a new window began.
        failures: Key frames on which the detector or the fusion failed; the log holds the errors.
    """

    images: int = 0
    poses: int = 0
    passed_over: int = 0
    unposed: int = 0
    misdated: int = 0
    key_frames: int = 0
    looked_at: int = 0
    dropped: int = 0
    jumps: int = 0
    failures: int = 0


@dataclass(kw_only=True)
class FrameRectifier:
    """Undistorts and shrinks the camera's images."""

    camera: Camera
    width_px: int
    pinhole: Camera = field(init=False)

    def __post_init__(self) -> None:
        self._distortion_map = distortion_map(self.camera)
        factor = min(1.0, self.width_px / self.camera.width)
        self.pinhole = self.camera.undistorted().scaled(factor)

    def rectify(self, image: GreyImage) -> GreyImage:
        """The image, undistorted and shrunk."""
        if self._distortion_map is not None:
            image = np.rint(sample(image, self._distortion_map)).clip(0, 255).astype(np.uint8)
        if self.pinhole.width == self.camera.width:
            return image.copy()
        size = (self.pinhole.width, self.pinhole.height)
        return np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA), np.uint8)


class KeyFrameSelector:
    """Joins images with their poses and keeps those taken far enough apart.

    Args:
        camera: That takes the images.
        settings: How long images wait, and how far apart key frames are.

    Attributes:
        counts: What became of everything that came in.
        window: The key frames; another window after a jump or for another camera.
        rectifier: Makes key frames of the camera's images.
        inverse_depth: Typical of the background, 1 / m: parallax is counted by it.
    """

    def __init__(self, camera: Camera, settings: LocatorSettings) -> None:
        self._settings = settings
        self.counts = LocatorCounts()
        self.inverse_depth = 1 / settings.expected_range_m
        self._poses = PoseBuffer(max_gap_ns=round(settings.max_pose_gap_s * NS_PER_S))
        self._images: dict[int, GreyImage] = {}
        self._gate: StampGate[tuple[int, GreyImage]] = StampGate()
        self._number = 0
        self.set_camera(camera)

    def set_camera(self, camera: Camera) -> None:
        """Goes on with another camera, in another window."""
        self.rectifier = FrameRectifier(camera=camera, width_px=self._settings.width_px)
        self._images.clear()
        self._begin_window()

    def check_image(self, image: GreyImage) -> None:
        """Refuses an image that the camera cannot have taken.

        Raises:
            BadInputError: Its size or type is not the camera's.
        """
        camera = self.rectifier.camera
        if image.dtype != np.uint8 or image.shape != (camera.height, camera.width):
            raise BadInputError(
                f"image is {image.shape} {image.dtype}; the camera takes "
                f"({camera.height}, {camera.width}) uint8"
            )

    def add_pose(self, pose: StampedPose) -> None:
        """Takes a pose; where its clock went back (a replay), a new window begins."""
        self.counts.poses += 1
        if self._poses.add(pose):
            self._restart_after_jump()
        self._match_poses()

    def add_image(self, image: GreyImage, stamp_ns: int) -> None:
        """Takes an image; it waits for its pose if need be."""
        self.counts.images += 1
        admitted = self._gate.admit(stamp_ns, (stamp_ns, image.copy()))
        if admitted.went_back:
            self._images.clear()
        self._images.update(admitted.messages)
        self._match_poses()

    def _begin_window(self) -> None:
        self.window = FrameWindow(
            self.rectifier.pinhole,
            first=self._number,
            most=self._settings.frames_kept,
            lag=self._settings.lag,
        )
        self._last_pose: StampedPose | None = None
        self._last_key: StampedPose | None = None

    def _restart_after_jump(self) -> None:
        self.counts.jumps += 1
        self._begin_window()

    def _match_poses(self) -> None:
        """Joins waiting images with their poses, and drops those that waited too long."""
        self.counts.misdated = self._poses.left_out + self._gate.left_out
        newest_ns = max(self._poses.newest_ns or 0, self._gate.newest_ns or 0)
        oldest_ns = newest_ns - round(self._settings.patience_s * NS_PER_S)
        surplus = len(self._images) - self._settings.images_kept
        for place, stamp_ns in enumerate(sorted(self._images)):
            pose = self._poses.interpolate_at(stamp_ns)
            if pose is not None:
                self._select_image(self._images.pop(stamp_ns), pose)
            elif stamp_ns < oldest_ns or place < surplus:
                del self._images[stamp_ns]
                self.counts.unposed += 1

    def _select_image(self, image: GreyImage, pose: StampedPose) -> None:
        """Keeps the image as a key frame where the camera has moved enough since the last."""
        if self._last_pose is not None and self._is_jump(self._last_pose, pose):
            self._restart_after_jump()
        self._last_pose = pose
        if self._last_key is not None:
            baseline = np.linalg.norm(pose.center_in_world - self._last_key.center_in_world)
            focal_share = self.rectifier.pinhole.focal_px / self.rectifier.pinhole.width
            if baseline * self.inverse_depth * focal_share < self._settings.spacing:
                self.counts.passed_over += 1
                return
        self._last_key = pose
        key = WindowFrame(number=self._number, image=self.rectifier.rectify(image), pose=pose)
        self._number += 1
        self.counts.key_frames += 1
        self.counts.dropped += self.window.add(key)

    def _is_jump(self, before: StampedPose, after: StampedPose) -> bool:
        distance = float(np.linalg.norm(after.center_in_world - before.center_in_world))
        seconds = abs(after.stamp_ns - before.stamp_ns) / NS_PER_S
        return distance > max(LEAST_JUMP_M, self._settings.max_speed_mps * seconds)
