"""Across the axis of a column: what one view shows of one section, and where the axis lies in it.

Two measurements show it. The evidence is where the plume is, but reaches as far out as light is
bent at all, and further where the background shows it better. The displacement turns its sign at
the axis: light is bent away from warm air on both sides, and towards a denser gas. How well it is
known differs from section to section, with the background and with turbulence, and shows in how
much of it a change of sign leaves unexplained: each section is matched as if its noise were
unknown.
"""

from dataclasses import dataclass

import cv2
import numpy as np

from geometry.arrays import FloatArray, FloatMap
from geometry.grid import lever_gate
from geometry.trajectory import Trajectory
from locate.fusion.search.columns import PlumeColumn
from locate.fusion.search.score import FOOTPRINT_SHARE, NEAREST_DEPTH_UNITS
from locate.fusion.views import TURBULENCE_PX, Views

REACH_RADII, SAMPLES = 2.5, 101
"""How far from its axis a column is sampled, in radii, and how often; chosen by hand."""
REACH = np.linspace(-REACH_RADII, REACH_RADII, SAMPLES)
SEARCHED = np.abs(REACH) <= REACH_RADII - FOOTPRINT_SHARE
PLACES = REACH[SEARCHED]
"""(C,) where the axis may be: places whose outline is sampled as a whole, in radii."""
EDGE_SAMPLES = 5
"""Standard deviation of the blur of the outline's edge, samples; chosen by hand."""
OUTLINE = cv2.GaussianBlur(
    (np.abs(REACH) <= FOOTPRINT_SHARE).astype(float)[None], (0, 0), EDGE_SAMPLES
)[0]
OUTLINE /= OUTLINE.sum()
REVERSAL_WIDTH_RADII = 0.3
"""From the axis to where the displacement is largest, in radii: 0.2, 0.22 and 0.4 were no better on
the development plants (docs/archive/tried.md)."""
FROM_PLACE = (REACH - PLACES[:, None]) / REVERSAL_WIDTH_RADII
REVERSAL = FROM_PLACE * np.exp(-(FROM_PLACE**2) / 2)
"""(C, P) displacement across a Gaussian plume whose axis is at each place."""
NEAR_RADII = 0.5
"""How near the column's own axis the bending sign is taken, in radii; chosen by hand."""
OUTLINE_SAMPLE_PX2, REVERSAL_SAMPLE_PX2 = 10.0, 36.0
"""Pixels of the maps that count as one independent sample of the evidence and of the displacement;
chosen by hand."""
OUTLINE_SHARE, OUTLINE_ERROR_RADII = 0.1, 0.4
"""What the outline counts beside the displacement, and how far aside it may lie, in radii; set on
eight development plants at 1 px (docs/archive/tried.md)."""
OUTLINE_ERROR = np.exp(-(((PLACES - PLACES[:, None]) / OUTLINE_ERROR_RADII) ** 2) / 2)
OUTLINE_ERROR /= OUTLINE_ERROR.sum(axis=1, keepdims=True)
"""(C, C) probability of the axis at each place, by where the outline has it."""
SECTION_SAW_LLR = 0.4
"""Mean evidence of an outline, nats a pixel, from which on it shows a plume; chosen by hand."""
LEAST_RADIUS_PX = 2.0
"""Narrower columns are sampled as if they were so wide, px of the maps; chosen by hand."""


@dataclass(frozen=True, kw_only=True)
class AxisProfile:
    """One section of a column in one view, at C places of the axis across it.

    Attributes:
        height: Middle of the section above the column's lowest point, along world Z.
        offsets_px: (C,) the places, from the column's own axis along the normal.
        outline: (C,) mean evidence within the column's outline, nats a pixel.
        samples: That many pixels of it count as independent.
        reversal_nats: (C,) how surely the displacement turns its sign there: positive where light
            is bent away from the axis, negative where towards it.
        derivatives: (8,) of the offset, by the axis point's world X and Y and by the view's pose,
            in gtsam's tangent of world_from_cam.
    """

    height: float
    offsets_px: FloatArray
    outline: FloatArray
    samples: float
    reversal_nats: FloatArray
    derivatives: FloatArray

    @property
    def reversal_near_axis(self) -> float:
        """The turn summed over the places near the column's own axis."""
        return float(self.reversal_nats[np.abs(PLACES) < NEAR_RADII].sum())

    def locate_axis(self, bending_sign: int) -> tuple[float, float] | None:
        """Offset of the axis and its standard deviation, px; None where nothing shows it.

        What the outline has wrong, its samples have wrong alike: it may lie aside by
        `OUTLINE_ERROR_RADII`, however sharp it is.

        Args:
            bending_sign: 1 where the plume bends light away from its axis, -1 where towards it.
        """
        if self.outline.max() < SECTION_SAW_LLR:
            return None
        outlined = np.exp(OUTLINE_SHARE * self.samples * (self.outline - self.outline.max()))
        nats = np.maximum(bending_sign * self.reversal_nats, 0) + np.log(OUTLINE_ERROR @ outlined)
        best = int(np.argmax(nats))
        if best in (0, len(nats) - 1):
            return None
        likelihood = np.exp(nats - nats[best])
        variance = likelihood @ (self.offsets_px - self.offsets_px[best]) ** 2 / likelihood.sum()
        variance += (self.offsets_px[1] - self.offsets_px[0]) ** 2 / 12
        return float(self.offsets_px[best]), float(np.sqrt(variance))


def measure_profile(
    views: Views, core: FloatMap, i: int, column: PlumeColumn, heights: FloatArray
) -> AxisProfile | None:
    """A section of a column; None where it is too close to the camera.

    Args:
        views: The evidence.
        core: (V, H, W) the evidence of the middle of a plume.
        i: Row of the view.
        column: The column.
        heights: (S,) of the section, above the column's lowest point.
    """
    trajectory = views.trajectory
    points = column.axis_points(heights)
    in_cam = trajectory.world_to_cam(i, points)
    depth = in_cam[:, 2]
    if (depth < NEAREST_DEPTH_UNITS * views.unit).any():
        return None
    pixel = trajectory.camera.project(in_cam)
    normal = _axis_normal(trajectory, i, points, column)
    radii_px = trajectory.camera.focal_px * column.radii_at(heights) / depth
    radii_px = np.maximum(radii_px, LEAST_RADIUS_PX)
    sampled = pixel[:, None] + (radii_px[:, None] * REACH)[..., None] * normal
    x, y = np.moveaxis(sampled.astype(np.float32), -1, 0)
    background = cv2.remap(
        views.inverse_depth[i], x, y, cv2.INTER_NEAREST, borderValue=float("nan")
    )
    gate = lever_gate(depth[:, None].astype(np.float32), np.asarray(background, np.float32))
    llr = cv2.remap(core[i], x, y, cv2.INTER_LINEAR, borderValue=0) * gate
    measured = cv2.remap(views.measured_mask[i], x, y, cv2.INTER_LINEAR, borderValue=0) * gate
    displacement = cv2.remap(views.displacement[i], x, y, cv2.INTER_LINEAR, borderValue=0) @ normal
    length_px = float(np.linalg.norm(pixel[-1] - pixel[0])) * len(heights) / (len(heights) - 1)
    radius_px = float(radii_px.mean())
    samples_each = length_px * radius_px * (REACH[1] - REACH[0]) / REVERSAL_SAMPLE_PX2
    outline = np.correlate(llr.mean(axis=0), OUTLINE, mode="same")
    return AxisProfile(
        height=float(heights.mean()),
        offsets_px=PLACES * radius_px,
        outline=outline[SEARCHED],
        samples=2 * FOOTPRINT_SHARE * radius_px * length_px / OUTLINE_SAMPLE_PX2,
        reversal_nats=_reversal_nats(measured * samples_each, displacement),
        derivatives=_offset_derivatives(trajectory, i, points.mean(axis=0), normal),
    )


def _reversal_nats(samples: FloatMap, displacement: FloatMap) -> FloatArray:
    """(C,) nats for `REVERSAL` of a free size in noise of a free size, signed.

    With one sample of prior.

    Args:
        samples: (S, P) independent samples that one of P places counts as over the whole section;
            0 if unmeasured.
        displacement: (S, P) across the axis, px.
    """
    counted = samples.mean(axis=0)
    along = REVERSAL @ (samples * displacement).mean(axis=0)
    total = TURBULENCE_PX**2 + (samples * displacement**2).mean(axis=0).sum()
    explained = along**2 / np.maximum(REVERSAL**2 @ counted, 1e-9) / total
    nats = -np.log1p(-explained) * (1 + counted.sum()) / 2
    return np.asarray(np.sign(along) * nats)


def _axis_normal(
    trajectory: Trajectory, i: int, points: FloatArray, column: PlumeColumn
) -> FloatArray:
    """(2,) unit normal of the projected axis: the direction that is measured."""
    ahead = points + 1e-3 * column.direction
    tangent = (trajectory.project(i, ahead) - trajectory.project(i, points)).mean(axis=0)
    tangent /= max(float(np.linalg.norm(tangent)), 1e-12)
    return np.array([-tangent[1], tangent[0]])


def _offset_derivatives(
    trajectory: Trajectory, i: int, point: FloatArray, normal: FloatArray
) -> FloatArray:
    """(8,) of the offset along `normal`: by the point's world X and Y, and by the pose.

    The tangent of world_from_cam turns and shifts in the camera's own frame, so a point in it
    moves by `p x omega - v`.
    """
    x, y, z = trajectory.world_to_cam(i, point[None])[0]
    by_cam = normal @ np.array([[1, 0, -x / z], [0, 1, -y / z]]) * trajectory.camera.focal_px / z
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    by_shift = by_cam @ trajectory.rotations[i][:, :2]
    return np.concatenate([by_shift, by_cam @ cross, -by_cam])
