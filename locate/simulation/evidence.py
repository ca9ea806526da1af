"""The evidence of a column of warm air before planes, computed without any image.

What fusion and the robot's loop are tried with in seconds: a ground (z = 0), a wall behind the
column, cameras on an arc, and the faults of a detector and of poses. World: metres, Z up.
"""

from dataclasses import dataclass, replace

import cv2
import numpy as np

from geometry.arrays import FloatArray
from geometry.camera import Camera
from geometry.trajectory import Trajectory
from locate.fusion.search.columns import PlumeColumn
from locate.fusion.views import Views, correlation_area

RANGE_M = 8.5
"""Of the cameras from the origin."""
WALL_M = 6.0
"""World y of the wall."""
MOST_BENT_PX, BENT_AT_RADII = 1.0, 0.45
"""The largest displacement across a column, and where it is, in radii from the axis."""
SIGMA_PX = 0.1
"""Stated standard deviation of a displacement."""


@dataclass(frozen=True, kw_only=True)
class EvidenceFaults:
    """What goes wrong between true masks and poses and what fusion is given.

    Attributes:
        flipped_pixels: Share of the pixels whose evidence is wrong.
        missed_views: Share of the views that do not see the column.
        false_blobs: Share of the views with evidence somewhere else.
        position_sigma_m: Standard deviation of a camera's place along each axis.
        rotation_sigma_deg: Of its rotation about each axis.
    """

    flipped_pixels: float = 0.10
    missed_views: float = 0.30
    false_blobs: float = 0.20
    position_sigma_m: float = 0.01
    rotation_sigma_deg: float = 0.1


NO_FAULTS = EvidenceFaults(
    flipped_pixels=0, missed_views=0, false_blobs=0, position_sigma_m=0, rotation_sigma_deg=0
)


@dataclass(frozen=True, kw_only=True)
class ColumnTruth:
    """A slanted, widening column.

    Attributes:
        source: (3,) where it begins, world, m.
        slope: (2,) world X and Y that its axis gains per metre of height.
        height: Along world Z, m.
        radius: At the source, m.
        opening: What the radius gains per metre of height.
    """

    source: FloatArray
    slope: FloatArray
    height: float
    radius: float
    opening: float

    @property
    def axis(self) -> FloatArray:
        """(3,) unit vector of the rise."""
        direction = np.array([*self.slope, 1.0])
        return np.asarray(direction / np.linalg.norm(direction))

    @property
    def column(self) -> PlumeColumn:
        """The column as fusion describes it."""
        shape = (self.height, self.radius, self.opening)
        return PlumeColumn(np.array([*self.source, *self.slope, *shape]))


def random_column(rng: np.random.Generator) -> ColumnTruth:
    """A column somewhere near the origin."""
    return ColumnTruth(
        source=np.array([*rng.uniform(-1, 1, 2), 0.0]),
        slope=rng.uniform(-0.15, 0.15, 2),
        height=rng.uniform(1.8, 3.0),
        radius=rng.uniform(0.1, 0.18),
        opening=rng.uniform(0.06, 0.14),
    )


def orbit_trajectory(views: int, arc_deg: float, *, height_m: float = 2.0) -> Trajectory:
    """Cameras on an arc about the origin, looking at a point 1.2 m above it."""
    angles = np.deg2rad(np.linspace(-arc_deg / 2, arc_deg / 2, views))
    centers = np.stack(
        [RANGE_M * np.sin(angles), -RANGE_M * np.cos(angles), np.full(views, height_m)], axis=1
    )
    forward = np.array([0, 0, 1.2]) - centers
    forward /= np.linalg.norm(forward, axis=1, keepdims=True)
    right = np.cross(forward, [0, 0, 1.0])
    right /= np.linalg.norm(right, axis=1, keepdims=True)
    rotations = np.stack([right, np.cross(forward, right), forward], axis=1)
    return Trajectory(
        camera=Camera.pinhole(320, 240, 280.0),
        indices=np.arange(views),
        times_s=np.arange(views) / 5.0,
        rotations=rotations,
        translations=-np.einsum("nij,nj->ni", rotations, centers),
        metric=True,
        gravity=True,
    )


def _inverse_depth(trajectory: Trajectory, i: int) -> FloatArray:
    """Of the ground (z = 0) and a wall (y = WALL_M) behind the column."""
    camera = trajectory.camera
    rays = camera.rays(camera.pixel_grid())
    rays_in_world = rays @ trajectory.rotations[i]
    center = trajectory.centers_in_world[i]
    with np.errstate(divide="ignore"):
        ground = np.where(rays_in_world[..., 2] < 0, -center[2] / rays_in_world[..., 2], np.inf)
        wall = (WALL_M - center[1]) / rays_in_world[..., 1]
    return 1 / (np.minimum(ground, np.where(wall > 0, wall, np.inf)) * rays[..., 2])


def _column_displacement(
    trajectory: Trajectory, i: int, truth: ColumnTruth, rng: np.random.Generator
) -> FloatArray:
    """(H, W) displacement along x, px, by the column, which meanders anew in each view; 0 outside.

    Light is bent away from the axis, as the middle of a column of Gaussian profile does it.
    """
    heights = np.linspace(0, truth.height, 60)
    points = truth.source + heights[:, None] * np.array([*truth.slope, 1.0])
    radius = truth.radius + truth.opening * heights
    phase, length = rng.uniform(0, 2 * np.pi), rng.uniform(1.0, 2.5)
    sway = 0.35 * radius * np.sin(2 * np.pi * heights / length + phase) * heights / truth.height
    points += sway[:, None] * trajectory.rotations[i][0]
    pixels = trajectory.project(i, points)
    depth = trajectory.world_to_cam(i, points)[:, 2]
    mask = np.zeros((trajectory.camera.height, trajectory.camera.width), np.uint8)
    half_px = trajectory.camera.focal_px * radius / depth
    left = pixels - np.stack([half_px, 0 * half_px], axis=1)
    right = 2 * pixels - left
    outline = np.concatenate([left, right[::-1]])
    cv2.fillPoly(mask, [np.rint(outline * 16).astype(np.int32)], 1, shift=4)
    upwards = np.argsort(pixels[:, 1])
    rows = np.arange(len(mask))
    middle, half = (
        np.interp(rows, pixels[upwards, 1], along[upwards])[:, None]
        for along in (pixels[:, 0], half_px)
    )
    from_axis = (np.arange(mask.shape[1]) - middle) / (BENT_AT_RADII * half)
    return np.asarray(mask * MOST_BENT_PX * from_axis * np.exp(0.5 - from_axis**2 / 2))


def make_faulty_views(
    truth: ColumnTruth | None,
    trajectory: Trajectory,
    rng: np.random.Generator,
    faults: EvidenceFaults = EvidenceFaults(),
) -> Views:
    """The evidence of a detector with these faults, and poses with these errors.

    Args:
        truth: The column; None for a scene without one.
        trajectory: The true one.
        rng: Of the faults and of the column's shape in each view.
        faults: How often and how far each goes wrong.
    """
    shape = (trajectory.camera.height, trajectory.camera.width)
    maps = []
    displacement = np.zeros((len(trajectory), *shape, 2), np.float32)
    for i in range(len(trajectory)):
        if truth is not None and rng.random() >= faults.missed_views:
            displacement[i, ..., 0] = _column_displacement(trajectory, i, truth, rng)
        mask = displacement[i, ..., 0] != 0
        if rng.random() < faults.false_blobs:
            blob = np.zeros(shape, np.uint8)
            center = rng.integers([0, 0], shape[::-1])
            axes = rng.integers(6, 25, 2)
            cv2.ellipse(blob, center.tolist(), axes.tolist(), rng.uniform(0, 180), 0, 360, 1, -1)
            mask |= blob.astype(bool)
        mask ^= rng.random(shape) < faults.flipped_pixels
        maps.append(np.where(mask, 2.0, -0.5).astype(np.float32))
    inverse_depth = [_inverse_depth(trajectory, i) for i in range(len(trajectory))]
    llr = np.stack(maps)
    return Views(
        trajectory=_perturb_poses(trajectory, rng, faults),
        llr=llr,
        inverse_depth=np.stack(inverse_depth).astype(np.float32),
        displacement=displacement,
        sigma_px=np.full_like(llr, SIGMA_PX),
        correlation_px2=correlation_area(llr),
    )


def add_plume(
    views: Views, truth: ColumnTruth, trajectory: Trajectory, rng: np.random.Generator
) -> Views:
    """The views with one plume more, before those that they show.

    Args:
        views: Of `make_faulty_views`.
        truth: The plume; some views miss it.
        trajectory: The true one.
        rng: Of its faults and its shape.
    """
    one_fault = EvidenceFaults(flipped_pixels=0, false_blobs=0)
    other = make_faulty_views(truth, trajectory, rng, one_fault)
    llr = np.where(other.llr > 0, other.llr, views.llr)
    return replace(
        views,
        llr=llr,
        displacement=views.displacement + other.displacement,
        correlation_px2=correlation_area(llr),
    )


def _perturb_poses(
    trajectory: Trajectory, rng: np.random.Generator, faults: EvidenceFaults
) -> Trajectory:
    n = len(trajectory)
    turn = np.deg2rad(faults.rotation_sigma_deg)
    rotations = (
        np.array([cv2.Rodrigues(rng.normal(0, turn + 1e-12, 3))[0] for _ in range(n)])
        @ trajectory.rotations
    )
    centers = trajectory.centers_in_world + rng.normal(0, faults.position_sigma_m, (n, 3))
    variances = np.repeat([turn**2, faults.position_sigma_m**2], 3) + 1e-12
    return replace(
        trajectory,
        rotations=rotations,
        translations=-np.einsum("nij,nj->ni", rotations, centers),
        covariances=np.tile(np.diag(variances), (n, 1, 1)),
    )
