"""One frame: the rays of a camera, bent by the plumes, and what they bring back."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from geometry.arrays import BoolArray, FloatArray, FloatMap, GreyImage, IntArray
from geometry.camera import Camera
from geometry.trajectory import Trajectory
from locate.simulation.image_formation import area_mean, expose_image
from locate.simulation.plume_field import PlumeField, RayBend, visible_percentile
from locate.simulation.scene import Scene
from locate.simulation.shutter import INSTANT, Shutter, camera_velocities
from locate.simulation.surfaces import RayHits, SurfaceModel

MASK_SHARE = 0.3
NEGLIGIBLE_PX = 1e-4
SKY_M = 1e5
BAND_RAYS = 2**16
COARSE_SIDE = 640
"""Least width, in rays, of the grid on which the bending is integrated."""
TRIAL_FRAMES = 6
TRIAL_STRIDE = 3


@dataclass(frozen=True, kw_only=True)
class RenderedTruth:
    """What is true of one frame.

    Attributes:
        displacement: (H, W, 2) px: pixel p shows the background of p + displacement(p).
        mask: (H, W) |displacement| above 0.3 of the amplitude of the weakest plume.
        depth: (H, W) of the background along the optical axis, m; inf in the sky.
    """

    displacement: FloatMap
    mask: BoolArray
    depth: FloatMap


class Renderer:
    """Renders the frames of one recording.

    Args:
        scene: What to render.
        world: Its surfaces.
        fields: Its plumes.
        trajectory: Its camera.
        shutter: How long a frame takes, and how bright it comes out.
    """

    def __init__(
        self,
        scene: Scene,
        world: SurfaceModel,
        fields: Sequence[PlumeField],
        trajectory: Trajectory,
        shutter: Shutter = INSTANT,
    ) -> None:
        self._scene = scene
        self._shutter = shutter
        self._world = world
        self._fields = fields
        self._trajectory = trajectory
        self.camera = trajectory.camera
        self._coarse_px = _coarse_spacing(self.camera)
        self._pixel_rays = _unit_rays(self.camera)
        self._coarse_rays = _unit_rays(self.camera, spacing=self._coarse_px)
        self._fine_rays = _unit_rays(self.camera, samples=scene.image.samples)
        self.amplitudes_px = [self._calibrate_gain(field) for field in fields]

    def render_frame(self, i: int, *, with_plumes: bool = True) -> tuple[GreyImage, RenderedTruth]:
        """Frame `i` as the camera stores it, and the truth about it."""
        samples = self._scene.image.samples
        world = self._world.at(float(self._trajectory.times_s[i]))
        bends = self._bends(i) if with_plumes else []
        radiance = np.empty(self._fine_rays.shape[:2], dtype=np.float32)
        displacement = np.zeros((self.camera.height, self.camera.width, 2), dtype=np.float32)
        depth = np.empty(displacement.shape[:2], dtype=np.float32)
        for rows in self._bands():
            fine = slice(rows.start * samples, rows.stop * samples)
            radiance[fine], w, along_axis = self._follow_rays(i, world, bends, fine)
            displacement[rows] = area_mean(w, samples)
            depth[rows] = _lower_median(along_axis, samples)
        gain = self._scene.image.gain * self._shutter.frame_gain(i)
        formation = self._scene.image.model_copy(update={"gain": gain})
        image = expose_image(radiance, formation, self._scene.random_stream(4, i))
        weakest = min(self.amplitudes_px, default=0.0)
        size = np.linalg.norm(displacement, axis=-1)
        mask = size > max(MASK_SHARE * weakest, NEGLIGIBLE_PX)
        return image, RenderedTruth(displacement=displacement, mask=mask, depth=depth)

    def _bands(self) -> Iterator[slice]:
        """Rows of pixels whose fine rays fit a processor's cache, in whole coarse rows."""
        rays = self._fine_rays.shape[1] * self._scene.image.samples * self._coarse_px
        step = max(1, BAND_RAYS // rays) * self._coarse_px
        for top in range(0, self.camera.height, step):
            yield slice(top, min(top + step, self.camera.height))

    def _follow_rays(
        self, i: int, world: SurfaceModel, bends: Sequence[RayBend], rows: slice
    ) -> tuple[FloatMap, FloatMap, FloatMap]:
        """Follows some rows (h, W) of fine rays to where they end.

        Returns:
            Radiance (h, W); displacement (h, W, 2) px; depth (h, W) along the optical axis, m.
        """
        rays = self._fine_rays[rows]
        shape = rays.shape[:2]
        delays_s = self._delays_s(self._fine_rays.shape[:2], rows)
        directions = self._to_world(i, rays, delays_s)
        origins = self._ray_origins(i, len(directions), delays_s)
        hits = world.cast_rays(origins, directions)
        along_axis = hits.range_m * rays[..., 2].ravel()
        path_m = hits.range_m.copy()
        w = np.zeros((len(directions), 2), dtype=np.float32)
        deflected = [part for bend in bends if (part := self._refine_bend(bend, rows)) is not None]
        if deflected:
            bent, w[bent] = self._bend_rays(i, world, origins, directions, hits, path_m, deflected)
        radiance = world.compute_radiance(
            origins,
            directions,
            hits,
            path_m=path_m,
            ray_width_rad=1 / (self.camera.focal_px * self._scene.image.samples),
        )
        return radiance.reshape(shape), w.reshape(*shape, 2), along_axis.reshape(shape)

    def _delays_s(self, shape: tuple[int, ...], rows: slice = slice(None)) -> FloatMap | None:
        """(N, 1) of some rows of a grid of rays of that shape; None where all are of one moment."""
        if self._shutter.is_instant:
            return None
        samples = max(1, shape[0] // self.camera.height)
        return self._shutter.delays_s(shape, samples)[rows].reshape(-1, 1)

    def _to_world(self, i: int, rays: FloatMap, delays_s: FloatMap | None) -> FloatMap:
        """(N, 3) directions of rays (H, W, 3) of the camera."""
        rotation = self._trajectory.rotations[i].astype(np.float32)
        directions = np.asarray(rays.reshape(-1, 3) @ rotation)
        if delays_s is None:
            return directions
        _, turning = camera_velocities(self._trajectory, i)
        directions += delays_s * np.cross(turning.astype(np.float32), directions)
        return np.asarray(directions / np.linalg.norm(directions, axis=1, keepdims=True))

    def _ray_origins(self, i: int, count: int, delays_s: FloatMap | None) -> FloatMap:
        """(N, 3) where rays start."""
        origins = np.tile(self._trajectory.centers_in_world[i].astype(np.float32), (count, 1))
        if delays_s is not None:
            moving, _ = camera_velocities(self._trajectory, i)
            origins += delays_s * moving.astype(np.float32)
        return origins

    def _bend_rays(
        self,
        i: int,
        world: SurfaceModel,
        origins: FloatMap,
        directions: FloatMap,
        hits: RayHits,
        path_m: FloatMap,
        bends: Sequence[RayBend],
    ) -> tuple[IntArray, FloatMap]:
        """Sends the rays that cross a plume on from where it bends them, in place.

        Returns:
            Which rays, and their (N, 2) displacement, px.
        """
        deflection, turn_m = _sum_bends(bends, hits.range_m)
        felt_px = np.linalg.norm(deflection, axis=-1) * self.camera.focal_px
        bent = np.flatnonzero(felt_px > NEGLIGIBLE_PX).astype(np.int64)
        straight, deflection, turn_m = directions[bent], deflection[bent], turn_m[bent]
        legs = straight + deflection
        legs /= np.linalg.norm(legs, axis=1, keepdims=True)
        origins[bent] += straight * turn_m[:, None]
        directions[bent] = legs
        last = world.cast_rays(origins[bent], legs)
        path_m[bent] = turn_m + last.range_m
        hits.range_m[bent] = last.range_m
        hits.triangle[bent] = last.triangle
        hits.barycentric[bent] = last.barycentric
        rotation = self._trajectory.rotations[i]
        return bent, apparent_shift(
            self.camera, rotation, straight, deflection, turn_m, last.range_m
        )

    def _bends(self, i: int) -> list[RayBend]:
        """What each plume does to the coarse rays of frame `i`.

        The bending is smooth over the image: it is integrated along coarse rays and interpolated
        to the fine ones, whose own ends then say how much of it they undergo.
        """
        center = self._trajectory.centers_in_world[i]
        delays_s = self._delays_s(self._coarse_rays.shape[:2])
        directions = self._to_world(i, self._coarse_rays, delays_s)
        return [field.bend_rays(i, center, directions) for field in self._fields]

    def _refine_bend(self, bend: RayBend, rows: slice) -> RayBend | None:
        """The bending of some rows of fine rays; None where there is none."""
        height, width = self._coarse_rays.shape[:2]
        factor = self._fine_rays.shape[0] // height
        first, end = rows.start // factor, rows.stop // factor
        above, below = max(first - 1, 0), min(end + 1, height)
        around = slice(above * width, below * width)
        if not bend.deflection[around].any():
            return None
        fine_shape = (self._fine_rays.shape[1], (below - above) * factor)
        kept = slice((first - above) * factor, (end - above) * factor)

        def grow(values: FloatMap) -> FloatMap:
            grid = values[around].reshape(below - above, width, -1)
            grown = cv2.resize(grid, fine_shape, interpolation=cv2.INTER_LINEAR)[kept]
            return np.asarray(grown.reshape(-1, *values.shape[1:]), dtype=np.float32)

        return RayBend(
            deflection=grow(bend.deflection),
            range_m=grow(bend.range_m),
            spread_m=grow(bend.spread_m),
        )

    def _calibrate_gain(self, field: PlumeField) -> float:
        """Sets the gain of a plume to reach its amplitude; returns the amplitude."""
        frames = len(self._trajectory)
        trial = np.unique(np.linspace(0, frames - 1, min(frames, TRIAL_FRAMES)).astype(int))
        amplitude = float(np.mean([self._trial_percentile(field, int(i)) for i in trial]))
        return field.scale_to(amplitude, field.plume.amplitude_px)

    def _trial_percentile(self, field: PlumeField, i: int) -> float:
        """The 95th percentile of |w| in frame `i`, on a coarse grid of rays."""
        rays = self._pixel_rays[::TRIAL_STRIDE, ::TRIAL_STRIDE]
        directions = self._to_world(i, rays, self._delays_s(rays.shape[:2]))
        center = self._trajectory.centers_in_world[i]
        origins = self._ray_origins(i, len(directions), None)
        world = self._world.at(float(self._trajectory.times_s[i]))
        ends = world.cast_rays(origins, directions).range_m
        bend = field.bend_rays(i, center, directions)
        lever = np.clip(1 - bend.range_m / ends, 0, 1) * bend.share_before(ends)
        across = bend.deflection @ self._trajectory.rotations[i].T.astype(np.float32)
        return visible_percentile(across[:, :2] * (lever * self.camera.focal_px)[:, None])


def apparent_shift(
    camera: Camera,
    cam_from_world: FloatArray,
    directions: FloatMap,
    deflection: FloatMap,
    turn_m: FloatMap,
    leg_m: FloatMap,
) -> FloatMap:
    """W of bent rays: where the place they reach would stand, less where they left the image.

    Args:
        camera: The camera.
        cam_from_world: (3, 3) its rotation.
        directions: (N, 3) unit directions in the world before the bend.
        deflection: (N, 3) what the bend adds to them.
        turn_m: (N,) range of the bend.
        leg_m: (N,) length of the ray behind the bend; inf in the sky.

    Returns:
        (N, 2) px.
    """
    straight = directions.astype(float)
    legs = straight + deflection
    legs /= np.linalg.norm(legs, axis=1, keepdims=True)
    reach = np.where(np.isfinite(leg_m), leg_m, SKY_M).astype(float)[:, None]
    seen = straight * turn_m[:, None] + legs * reach
    there, here = (camera.project(points @ cam_from_world.T) for points in (seen, straight))
    return np.asarray(there - here, dtype=np.float32)


def _coarse_spacing(camera: Camera) -> int:
    """Pixels between rays that stand at least `COARSE_SIDE` to a row, and fill the frame evenly."""
    common = math.gcd(camera.width, camera.height)
    return max(
        spacing
        for spacing in range(1, max(1, camera.width // COARSE_SIDE) + 1)
        if common % spacing == 0
    )


def _unit_rays(camera: Camera, *, samples: int = 1, spacing: int = 1) -> FloatMap:
    """(H * s, W * s, 3) unit rays through the middles of the parts of each pixel.

    With a spacing, (H / spacing, W / spacing, 3), through the middles of blocks of pixels.
    """
    part = spacing / samples
    x = (np.arange(camera.width * samples // spacing) + 0.5) * part - 0.5
    y = (np.arange(camera.height * samples // spacing) + 0.5) * part - 0.5
    return camera.rays(np.stack(np.meshgrid(x, y), axis=-1)).astype(np.float32)


def _lower_median(fine: FloatMap, samples: int) -> FloatMap:
    """(H, W) lower median of each block of samples x samples of a finer map."""
    height, width = fine.shape[0] // samples, fine.shape[1] // samples
    blocks = fine.reshape(height, samples, width, samples).transpose(0, 2, 1, 3)
    middle = (samples**2 - 1) // 2
    return np.partition(blocks.reshape(height, width, -1), middle, axis=-1)[..., middle]


def _sum_bends(bends: Sequence[RayBend], ends_m: FloatMap) -> tuple[FloatMap, FloatMap]:
    """Total deflection (N, 3) of rays up to where they end, and where they turn (N,)."""
    total = np.zeros((len(ends_m), 3), dtype=np.float32)
    weighted = np.zeros(len(ends_m), dtype=np.float32)
    weights = np.full(len(ends_m), 1e-20, dtype=np.float32)
    for bend in bends:
        part = bend.deflection * bend.share_before(ends_m)[:, None]
        size = np.linalg.norm(part, axis=-1)
        total += part
        weighted += size * bend.range_m
        weights += size
    return total, weighted / weights
