"""What a camera could see of a plume from there, by physics and by what has been measured."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import ceil, exp, pi, radians, sqrt, tan
from typing import Literal, Self

import numpy as np
from numpy.typing import ArrayLike

from detect.registered.neighbours import WANTED_PARALLAX
from detect.registered.registration import WINDOW_PX
from geometry.arrays import FloatArray
from geometry.errors import BadInputError
from geometry.refraction import AMBIENT_TEMPERATURE_K, lever_px, refractivity
from geometry.rising_plume import RisingPlume
from locate.pipeline.effort import EFFORTS

Coding = Literal["lossless", "video"]
STEP_SHARE = WANTED_PARALLAX[0] / 2
"""Parallax from one frame to the next, over the width, that gives neighbours on both sides."""
HEIGHTS = 400
"""At how many the displacement is computed."""
MEASURED_FRAMES, MOST_FRAMES = EFFORTS["usual"].detection_frames, EFFORTS["usual"].max_frames
"""Frames in which a run measures, and the most that it takes, where nothing else is asked."""
NEEDED_PX: dict[Coding, float] = {"lossless": 0.1, "video": 0.3}
"""Strength of which about half or more were found (docs/plan.md)."""


@dataclass(frozen=True, kw_only=True)
class PlannedSource:
    """What gives off the plume.

    Attributes:
        gas: See `geometry.refraction`.
        mole_fraction: Its share at the source, the rest is air.
        temperature_k: At the source; the surroundings are at `AMBIENT_TEMPERATURE_K`.
        plume: How it spreads.
    """

    gas: str = "air"
    mole_fraction: float = 1.0
    temperature_k: float = AMBIENT_TEMPERATURE_K
    plume: RisingPlume

    def index_difference(self, share: ArrayLike) -> FloatArray:
        """N of the plume where the source's fluid has this share, less that of the surroundings."""
        part = np.asarray(share, dtype=float)
        rise_k = self.temperature_k - AMBIENT_TEMPERATURE_K
        there = refractivity(
            self.gas, part * self.mole_fraction, AMBIENT_TEMPERATURE_K + part * rise_k
        )
        return np.asarray(there - refractivity())


@dataclass(frozen=True, kw_only=True)
class PlannedView:
    """The camera, and where it stands.

    Attributes:
        width: Of the frames that are measured, px.
        height: Likewise.
        focal_px: Likewise.
        range_to_plume_m: Along the optical axis.
        range_to_background_m: Likewise; inf for a background far away.
    """

    width: int
    height: int
    focal_px: float
    range_to_plume_m: float
    range_to_background_m: float

    @classmethod
    def of_camera(
        cls,
        size: tuple[int, int],
        *,
        focal_px: float | None,
        fov_deg: float | None,
        max_side: int,
        range_to_plume_m: float,
        range_to_background_m: float,
    ) -> Self:
        """The view of a camera, its frames reduced as a run does.

        Args:
            size: Width and height of its own frames, px.
            focal_px: Of these; or
            fov_deg: the horizontal angle of view; one of the two.
            max_side: Frames longer than this are reduced to it.
            range_to_plume_m: Along the optical axis.
            range_to_background_m: Likewise.

        Raises:
            BadInputError: Both or none of the two, or the background is not behind the plume.
        """
        if (focal_px is None) == (fov_deg is None):
            raise BadInputError(
                "give either --focal (px) or --fov (degrees across the width, 65 of most phones)"
            )
        own_px = focal_px or size[0] / (2 * tan(radians(fov_deg or 0) / 2))
        factor = min(1.0, max_side / max(size))
        view = cls(
            width=round(size[0] * factor),
            height=round(size[1] * factor),
            focal_px=own_px * factor,
            range_to_plume_m=range_to_plume_m,
            range_to_background_m=range_to_background_m,
        )
        view.lever_px  # noqa: B018 - it refuses a background that is before the plume
        return view

    @property
    def lever_px(self) -> float:
        """Displacement in px per rad of deflection."""
        return lever_px(
            range_to_plume_m=self.range_to_plume_m,
            range_to_background_m=self.range_to_background_m,
            focal_px=self.focal_px,
        )

    @property
    def shown_m(self) -> float:
        """How much of a plume's height the frame holds."""
        return self.height * self.range_to_plume_m / self.focal_px


@dataclass(frozen=True, kw_only=True)
class Level:
    """A plume at one height.

    Attributes:
        height_m: Above its source (below, where it sinks).
        radius_m: Standard deviation of its profile.
        radius_px: The same in the image.
        share: Of the source's fluid on the axis.
        displacement_px: The largest, as it is measured.
    """

    height_m: float
    radius_m: float
    radius_px: float
    share: float
    displacement_px: float


@dataclass(frozen=True, kw_only=True)
class Plan:
    """What a camera could see of a plume.

    Attributes:
        source: What gives it off.
        view: The camera, and where it stands.
        coding: How its frames are stored.
        arc_deg: How far the camera goes round the plume.
        window_px: Standard deviation of the window of the measurement.
    """

    source: PlannedSource
    view: PlannedView
    coding: Coding = "video"
    arc_deg: float = 45.0
    window_px: float = WINDOW_PX

    def peak_px(self, height_m: ArrayLike) -> FloatArray:
        """The largest displacement at each height, one radius from the axis, px."""
        plume, view = self.source.plume, self.view
        radius_px = view.focal_px * plume.radius_at(height_m) / view.range_to_plume_m
        seen = radius_px**2 / (radius_px**2 + self.window_px**2)
        delta_n = np.abs(self.source.index_difference(plume.share_at(height_m)))
        return np.asarray(delta_n * view.lever_px * sqrt(2 * pi) * exp(-0.5) * seen)

    @property
    def strength_px(self) -> float:
        """The largest displacement at any height that the frame holds, px.

        Of the mean of the plume; turbulence sharpens what one frame shows (docs/plan.md).
        """
        return float(self.peak_px(np.linspace(0, self.view.shown_m, HEIGHTS)).max())

    def levels(self, heights_m: Sequence[float]) -> list[Level]:
        """The plume at some heights."""
        plume, view = self.source.plume, self.view
        return [
            Level(
                height_m=height_m,
                radius_m=float(plume.radius_at(height_m)),
                radius_px=view.focal_px * float(plume.radius_at(height_m)) / view.range_to_plume_m,
                share=float(plume.share_at(height_m)),
                displacement_px=float(self.peak_px(height_m)),
            )
            for height_m in heights_m
        ]

    @property
    def measured_frames(self) -> int | None:
        """In how many frames to measure; None where more than a run takes would be needed.

        Noise falls with the root of their number.
        """
        lacking = NEEDED_PX[self.coding] / max(self.strength_px, 1e-9)
        needed = ceil(MEASURED_FRAMES * max(1.0, lacking) ** 2)
        return needed if needed <= MOST_FRAMES else None

    @property
    def path_m(self) -> float:
        """Length of the camera's way along the arc."""
        return radians(self.arc_deg) * self.view.range_to_plume_m

    @property
    def path_frames(self) -> int:
        """Frames along the arc that give each neighbours at small enough parallax."""
        view = self.view
        parallax_px = view.focal_px * self.path_m / view.range_to_background_m
        return max(MEASURED_FRAMES, ceil(parallax_px / (STEP_SHARE * view.width)) + 1)

    def at_range(self, range_to_plume_m: float) -> "Plan":
        """The same from nearer or farther, the background as far behind the plume as before."""
        behind_m = self.view.range_to_background_m - self.view.range_to_plume_m
        view = replace(
            self.view,
            range_to_plume_m=range_to_plume_m,
            range_to_background_m=range_to_plume_m + behind_m,
        )
        return replace(self, view=view)
