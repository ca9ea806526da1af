"""The last key frames and the evidence of the last views: all that is kept of the past."""

from collections import deque
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Self

import numpy as np

from detect.detection import Detection, Frames
from geometry.arrays import GreyImage
from geometry.camera import Camera
from locate.fusion.views import Views
from locate.messages.poses import StampedPose, trajectory_from_poses


@dataclass(frozen=True, kw_only=True)
class WindowFrame:
    """A key frame of the window.

    Attributes:
        number: Ascending by the order of arrival, from 0.
        image: (H, W) uint8, undistorted.
        pose: Where the camera was.
    """

    number: int
    image: GreyImage
    pose: StampedPose


@dataclass(frozen=True, kw_only=True)
class DetectionTask:
    """One key frame to detect in, with the frames around it.

    Attributes:
        key: The key frame.
        frames: All that the window holds.
        row: Which of them `key` is.
        window: That they belong to; frames of different windows are never combined.
    """

    window: "FrameWindow"
    key: WindowFrame
    frames: Frames
    row: int


class FrameWindow:
    """The last key frames: neighbours of each other, and those that wait for the detector.

    Args:
        camera: The pinhole of the undistorted frames.
        first: Number of its first key frame: the later a window, the larger.
        most: How many are kept.
        lag: A frame is detected in once so many have followed it: the detector takes neighbours
            on both sides.

    Attributes:
        camera: As given.
        first: As given.
    """

    def __init__(self, camera: Camera, *, first: int, most: int, lag: int) -> None:
        self.camera = camera
        self.first = first
        self._lag = lag
        self._keys: deque[WindowFrame] = deque(maxlen=most)
        self._waiting: set[int] = set()

    def __len__(self) -> int:
        return len(self._keys)

    def add(self, key: WindowFrame) -> bool:
        """Takes the next key frame; True where the one it replaces was still waiting."""
        full = len(self._keys) == self._keys.maxlen
        lost = full and self._keys[0].number in self._waiting
        if lost:
            self._waiting.remove(self._keys[0].number)
        self._keys.append(key)
        self._waiting.add(key.number)
        return lost

    def take_task(self, *, newest: bool, ending: bool = False) -> DetectionTask | None:
        """The next frame to detect in, which then no longer waits; None where none is ready.

        Args:
            newest: The newest that is ready rather than the oldest: frames that the detector has
                no time for are dropped as the oldest.
            ending: No more frames will come, so none needs followers.
        """
        ready = len(self._keys) - (0 if ending else self._lag)
        rows = [row for row in range(ready) if self._keys[row].number in self._waiting]
        if not rows:
            return None
        row = rows[-1 if newest else 0]
        keys = list(self._keys)
        self._waiting.remove(keys[row].number)
        trajectory = trajectory_from_poses(
            [key.pose for key in keys], [key.number for key in keys], self.camera
        )
        frames = Frames(images=[key.image for key in keys], trajectory=trajectory)
        return DetectionTask(window=self, key=keys[row], frames=frames, row=row)

    @property
    def waiting_count(self) -> int:
        """How many frames wait for the detector."""
        return len(self._waiting)


class EvidenceWindow:
    """The evidence of the last views by one camera, shrunk to the size that fusion works at.

    Args:
        most: How many views are kept.
    """

    def __init__(self, *, most: int) -> None:
        self._most = most
        self._views: dict[int, tuple[StampedPose, Views]] = {}

    def __len__(self) -> int:
        return len(self._views)

    @property
    def numbers(self) -> list[int]:
        """Key-frame numbers of the views, ascending."""
        return sorted(self._views)

    def copy(self) -> Self:
        """The same views, in a window that others coming in do not change."""
        other = type(self)(most=self._most)
        other._views = dict(self._views)
        return other

    def clear(self) -> None:
        """Forgets every view."""
        self._views.clear()

    def add(self, task: DetectionTask, detection: Detection) -> None:
        """Takes a detection of a key frame; the earliest view is dropped if the window is full."""
        key = task.key
        trajectory = trajectory_from_poses([key.pose], [key.number], task.window.camera)
        self._views[key.number] = key.pose, Views.from_detections([detection], trajectory)
        if len(self._views) > self._most:
            del self._views[min(self._views)]

    def view_of(self, number: int) -> tuple[StampedPose, Views]:
        """Of one key frame: its pose, and its evidence as one row."""
        return self._views[number]

    def poses(self) -> list[StampedPose]:
        """Of the views, by ascending number."""
        return [self._views[number][0] for number in self.numbers]

    def merge_views(self) -> Views:
        """All of them as one, by ascending number."""
        numbers = self.numbers
        parts = [self._views[number][1] for number in numbers]
        trajectory = trajectory_from_poses(self.poses(), numbers, parts[0].trajectory.camera)
        return Views(
            trajectory=trajectory,
            llr=np.concatenate([part.llr for part in parts]),
            inverse_depth=np.concatenate([part.inverse_depth for part in parts]),
            displacement=np.concatenate([part.displacement for part in parts]),
            sigma_px=np.concatenate([part.sigma_px for part in parts]),
            correlation_px2=_pool_correlation(parts),
        )


def _pool_correlation(parts: Iterable[Views]) -> float:
    """The views' mean correlation area, weighted by their variance as pooling them would."""
    areas, variances = np.array([(part.correlation_px2, part.llr.var()) for part in parts]).T
    return float(np.average(areas, weights=variances + 1e-12))
