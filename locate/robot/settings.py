"""Settings of a `Locator`: how much it keeps, how long it waits, how often it searches."""

from dataclasses import dataclass
from typing import Annotated

from geometry.errors import BadInputError


@dataclass(frozen=True, kw_only=True)
class LocatorSettings:
    """What a robot's builder may want to change; every bound holds the memory constant.

    The annotation of an attribute says what it is; the ROS 2 node shows the same words.

    Raises:
        BadInputError: A number is out of its range.
    """

    width_px: Annotated[int, "Wider images are shrunk to this width."] = 640
    neighbours: Annotated[int, "Key frames that each is compared with; fewer are faster."] = 8
    detector_workers: Annotated[
        int, "Key frames processed at the same time, each by its own processor."
    ] = 1
    spacing: Annotated[float, "Parallax between key frames, as a share of the image width."] = 0.02
    expected_range_m: Annotated[
        float, "Typical distance to the background, until it has been measured."
    ] = 10.0
    frames_kept: Annotated[int, "Key frames kept as neighbours of each other."] = 20
    lag: Annotated[int, "A key frame is processed once so many have followed it."] = 4
    views_kept: Annotated[int, "Views whose evidence is kept."] = 32
    views_a_decision: Annotated[int, "New views from one decision to the next."] = 4
    null_draws: Annotated[
        int, "Null draws of the window, at least; they set the level that chance alone reaches."
    ] = 8
    images_kept: Annotated[int, "Images that wait for their pose, at most."] = 60
    patience_s: Annotated[float, "An image whose pose is not there after this time is dropped."] = (
        1.0
    )
    max_pose_gap_s: Annotated[float, "Across a longer gap poses are not interpolated."] = 0.5
    max_speed_mps: Annotated[
        float, "A camera that seems faster has jumped: its world frame has moved."
    ] = 20.0
    drift: Annotated[
        bool, "Pose errors grow with time, as an odometry's do; otherwise each is independent."
    ] = True
    seed: Annotated[int, "Of every random choice."] = 0

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            if name not in ("seed", "lag", "drift") and not value > 0:
                raise BadInputError(f"{name} is {value}: it must be positive")
        if not 0 <= self.lag < self.frames_kept:
            raise BadInputError(f"lag is {self.lag}: it must be below frames_kept")
        if self.neighbours < 2:
            raise BadInputError(f"neighbours is {self.neighbours}: at least 2 show parallax")
        if self.null_draws < 2:
            raise BadInputError(f"null_draws is {self.null_draws}: their spread takes at least 2")
