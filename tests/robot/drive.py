"""A robot that drives past a known column of air, its images blank, its detector an oracle."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from detect.detection import Detection, Frames
from geometry.arrays import FloatArray, GreyImage
from locate.fusion.views import Views
from locate.messages.stamps import NS_PER_S

BLANK = np.zeros((240, 320), np.uint8)


@dataclass(frozen=True, kw_only=True)
class Moment:
    image: GreyImage
    world_from_cam: FloatArray
    covariance: FloatArray | None
    stamp_ns: int


def moments(views: Views, *, start_ns: int = 100 * NS_PER_S) -> Iterator[Moment]:
    """One for each view, 0.2 s apart."""
    trajectory = views.trajectory
    for i, center in enumerate(trajectory.centers_in_world):
        pose = np.eye(4)
        pose[:3, :3], pose[:3, 3] = trajectory.rotations[i].T, center
        covariance = None if trajectory.covariances is None else trajectory.covariances[i]
        yield Moment(
            image=BLANK,
            world_from_cam=pose,
            covariance=covariance,
            stamp_ns=start_ns + i * NS_PER_S // 5,
        )


class Oracle:
    """Says of a frame what `views` say of the view that was taken nearest to it."""

    name = "oracle"

    def __init__(self, views: Views) -> None:
        self.views = views
        self.seen: list[int] = []

    def detect(self, frames: Frames, index: int) -> Detection:
        assert frames.trajectory is not None
        center = frames.trajectory.centers_in_world[index]
        distance = np.linalg.norm(self.views.trajectory.centers_in_world - center, axis=1)
        i = int(distance.argmin())
        self.seen.append(i)
        return Detection(
            displacement=self.views.displacement[i],
            sigma_px=self.views.sigma_px[i],
            llr=self.views.llr[i],
            inverse_depth=self.views.inverse_depth[i],
        )
