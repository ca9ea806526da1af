"""One frame: the rays of a camera, bent by the plumes, and what they bring back."""

from collections.abc import Sequence
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
        self._pixel_rays = _unit_rays(self.camera, 1)
        self._fine_rays = _unit_rays(self.camera, scene.image.samples)
        self.amplitudes_px = [self._calibrate_gain(field) for field in fields]

    def render_frame(self, i: int, *, with_plumes: bool = True) -> tuple[GreyImage, RenderedTruth]:
        """Frame `i` as the camera stores it, and the truth about it."""
        shape = self._fine_rays.shape[:2]
        samples = self._scene.image.samples
        world = self._world.at(float(self._trajectory.times_s[i]))
        directions = self._to_world(i, self._fine_rays)
        origins = self._ray_origins(i)
        hits = world.cast_rays(origins, directions)
        along_axis = hits.range_m * self._fine_rays[..., 2].ravel()
        path_m = hits.range_m.copy()
        w = np.zeros((len(directions), 2), dtype=np.float32)
        if with_plumes and self._fields:
            bent, w[bent] = self._bend_rays(i, world, origins, directions, hits, path_m)
        radiance = world.compute_radiance(
            origins,
            directions,
            hits,
            path_m=path_m,
            ray_width_rad=1 / (self.camera.focal_px * samples),
        )
        gain = self._scene.image.gain * self._shutter.frame_gain(i)
        formation = self._scene.image.model_copy(update={"gain": gain})
        image = expose_image(radiance.reshape(shape), formation, self._scene.random_stream(4, i))
        return image, self._frame_truth(w.reshape(*shape, 2), along_axis.reshape(shape))

    def _frame_truth(self, w: FloatMap, depth: FloatMap) -> RenderedTruth:
        """What is true of each pixel, from its parts: the mean of w, the lower median of depth."""
        samples = self._scene.image.samples
        displacement = area_mean(w, samples)
        weakest = min(self.amplitudes_px, default=0.0)
        size = np.linalg.norm(displacement, axis=-1)
        return RenderedTruth(
            displacement=displacement,
            mask=size > max(MASK_SHARE * weakest, NEGLIGIBLE_PX),
            depth=np.sort(_pixel_blocks(depth, samples), axis=-1)[..., (samples**2 - 1) // 2],
        )

    def _to_world(self, i: int, rays: FloatMap) -> FloatMap:
        """(N, 3) directions of rays (H, W, 3) of the camera."""
        rotation = self._trajectory.rotations[i].astype(np.float32)
        directions = np.asarray(rays.reshape(-1, 3) @ rotation)
        if self._shutter.is_instant:
            return directions
        _, turning = camera_velocities(self._trajectory, i)
        samples = max(1, len(rays) // self.camera.height)
        delays_s = self._shutter.delays_s(rays.shape[:2], samples).reshape(-1, 1)
        directions += delays_s * np.cross(turning.astype(np.float32), directions)
        return np.asarray(directions / np.linalg.norm(directions, axis=1, keepdims=True))

    def _ray_origins(self, i: int) -> FloatMap:
        """(N, 3) where the fine rays start."""
        shape = self._fine_rays.shape[:2]
        center = self._trajectory.centers_in_world[i].astype(np.float32)
        origins = np.tile(center, (shape[0] * shape[1], 1))
        if not self._shutter.is_instant:
            moving, _ = camera_velocities(self._trajectory, i)
            delays_s = self._shutter.delays_s(shape, self._scene.image.samples).reshape(-1, 1)
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
    ) -> tuple[IntArray, FloatMap]:
        """Sends the rays that cross a plume on from where it bends them, in place.

        Returns:
            Which rays, and their (N, 2) displacement, px.
        """
        deflection, turn_m = self._ray_deflection(i, hits.range_m)
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

    def _ray_deflection(self, i: int, ends_m: FloatMap) -> tuple[FloatMap, FloatMap]:
        """Total deflection (N, 3) of each fine ray up to where it ends, and where it turns (N,).

        The bending is smooth over the image: it is integrated along the ray of each pixel and
        interpolated to the finer rays, whose own ends then say how much of it they undergo.
        """
        range_m = ends_m.reshape(self._fine_rays.shape[:2])
        center = self._trajectory.centers_in_world[i]
        rays = self._to_world(i, self._pixel_rays)
        total = np.zeros((*range_m.shape, 3), dtype=np.float32)
        weighted = np.zeros(range_m.shape, dtype=np.float32)
        weights = np.full(range_m.shape, 1e-20, dtype=np.float32)
        for field in self._fields:
            bend = _refine_bend(
                field.bend_rays(i, center, rays), self._pixel_rays.shape, range_m.shape
            )
            part = bend.deflection.reshape(total.shape) * bend.share_before(range_m)[..., None]
            size = np.linalg.norm(part, axis=-1)
            total += part
            weighted += size * bend.range_m
            weights += size
        return total.reshape(-1, 3), (weighted / weights).ravel()

    def _calibrate_gain(self, field: PlumeField) -> float:
        """Sets the gain of a plume to reach its amplitude; returns the amplitude."""
        frames = len(self._trajectory)
        trial = np.unique(np.linspace(0, frames - 1, min(frames, TRIAL_FRAMES)).astype(int))
        amplitude = float(np.mean([self._trial_percentile(field, int(i)) for i in trial]))
        return field.scale_to(amplitude, field.plume.amplitude_px)

    def _trial_percentile(self, field: PlumeField, i: int) -> float:
        """The 95th percentile of |w| in frame `i`, on a coarse grid of rays."""
        rays = self._pixel_rays[::TRIAL_STRIDE, ::TRIAL_STRIDE]
        directions = self._to_world(i, rays)
        center = self._trajectory.centers_in_world[i]
        origins = np.tile(center.astype(np.float32), (len(directions), 1))
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


def _unit_rays(camera: Camera, samples: int) -> FloatMap:
    """(H * s, W * s, 3) unit rays through the middles of the parts of each pixel."""
    x = (np.arange(camera.width * samples) + 0.5) / samples - 0.5
    y = (np.arange(camera.height * samples) + 0.5) / samples - 0.5
    return camera.rays(np.stack(np.meshgrid(x, y), axis=-1)).astype(np.float32)


def _pixel_blocks(fine: FloatMap, samples: int) -> FloatMap:
    height, width = fine.shape[0] // samples, fine.shape[1] // samples
    blocks = fine.reshape(height, samples, width, samples).transpose(0, 2, 1, 3)
    return blocks.reshape(height, width, -1)


def _refine_bend(bend: RayBend, shape: tuple[int, ...], fine: tuple[int, ...]) -> RayBend:
    """The bending of the pixels' rays, for the finer rays between them."""

    def grow(values: FloatMap) -> FloatMap:
        grid = values.reshape(*shape[:2], -1)
        grown = cv2.resize(grid, fine[::-1], interpolation=cv2.INTER_LINEAR)
        return np.asarray(grown, dtype=np.float32)

    return RayBend(
        deflection=grow(bend.deflection),
        range_m=grow(bend.range_m),
        spread_m=grow(bend.spread_m),
    )
