"""The static scene under rays: where they hit, and how bright it is there."""

from dataclasses import dataclass
from functools import cached_property
from typing import Protocol, Self

import numpy as np
from numpy.typing import NDArray

from geometry.arrays import FloatMap
from geometry.open3d_loader import load_open3d
from locate.simulation.reflectance import compute_reflectance
from locate.simulation.scene import Scene
from locate.simulation.solids import build_mesh
from locate.simulation.textures import CLOUDS, TextureAtlas, make_noise_textures

AMBIENT, SUNLIGHT = 0.25, 0.8
SURFACE_M = 2e-3


@dataclass(frozen=True, kw_only=True)
class RayHits:
    """Where N rays end.

    Attributes:
        range_m: (N,) along each ray; inf in the sky.
        triangle: (N,) index of the triangle hit; meaningless in the sky.
        barycentric: (N, 2) weights of its second and third corner.
    """

    range_m: FloatMap
    triangle: NDArray[np.uint32]
    barycentric: FloatMap


class SurfaceModel(Protocol):
    """What rays can hit."""

    def at(self, time_s: float) -> "SurfaceModel":
        """The surfaces as they stand at that time."""
        ...

    def cast_rays(self, origins: FloatMap, directions: FloatMap) -> RayHits:
        """Follows N rays, (N, 3) origins and unit directions, to the first surface."""
        ...

    def compute_radiance(
        self,
        origins: FloatMap,
        directions: FloatMap,
        hits: RayHits,
        *,
        path_m: FloatMap,
        ray_width_rad: float,
    ) -> FloatMap:
        """(N,) brightness at the end of each ray, as of `StaticSurfaces.compute_radiance`."""
        ...


class StaticSurfaces:
    """The surfaces and the light of a scene; nothing in it moves."""

    def __init__(self, scene: Scene) -> None:
        o3d = load_open3d()
        mesh = build_mesh(scene.objects)
        self._o3d = o3d
        self._rays = o3d.t.geometry.RaycastingScene(nthreads=1)
        corners = np.array(mesh.corners, dtype=np.float32).reshape(-1, 3)
        if len(corners):
            triangles = np.arange(len(corners), dtype=np.uint32).reshape(-1, 3)
            self._rays.add_triangles(o3d.core.Tensor(corners), o3d.core.Tensor(triangles))
        self._frames = np.array(mesh.frames, dtype=np.float32).reshape(-1, 2, 4)
        self._materials = np.array(mesh.materials, dtype=np.int32)
        self._keys = np.array(mesh.keys, dtype=np.int32)
        azimuth, elevation = np.radians(scene.sun_deg)
        self._sun = np.array(
            [
                np.cos(elevation) * np.cos(azimuth),
                np.cos(elevation) * np.sin(azimuth),
                np.sin(elevation),
            ],
            dtype=np.float32,
        )
        normals = np.array(mesh.normals, dtype=np.float32).reshape(-1, 3, 3)
        self._lambert = np.clip(normals @ self._sun, 0, 1)
        self._upward = normals[..., 2].mean(axis=1)
        self._scene = scene
        self._sky = scene.sky

    @cached_property
    def _noise_atlas(self) -> TextureAtlas:
        return TextureAtlas(make_noise_textures(self._scene.random_stream(1)))

    def at(self, _time_s: float) -> Self:
        """The same at all times."""
        return self

    def cast_rays(self, origins: FloatMap, directions: FloatMap) -> RayHits:
        """Follows N rays, (N, 3) origins and unit directions, to the first surface."""
        rays = np.concatenate([origins, directions], axis=1)
        answer = self._rays.cast_rays(self._o3d.core.Tensor(rays), nthreads=1)
        return RayHits(
            range_m=answer["t_hit"].numpy(),
            triangle=answer["primitive_ids"].numpy(),
            barycentric=answer["primitive_uvs"].numpy(),
        )

    def compute_radiance(
        self,
        origins: FloatMap,
        directions: FloatMap,
        hits: RayHits,
        *,
        path_m: FloatMap,
        ray_width_rad: float,
    ) -> FloatMap:
        """Brightness at the end of each ray, linear, 1 is white.

        Args:
            origins: (N, 3) where the last straight leg of each ray starts.
            directions: (N, 3) its unit direction.
            hits: Where it ends.
            path_m: (N,) length from the camera, which sets the footprint.
            ray_width_rad: Angle between neighbouring rays.

        Returns:
            (N,) radiance.
        """
        radiance = np.empty(len(directions), dtype=np.float32)
        finite = np.isfinite(hits.range_m)
        solid = slice(None) if finite.all() else np.flatnonzero(finite)
        if not finite.all():
            radiance[~finite] = self._sky_radiance(directions[~finite])
        if not finite.any():
            return radiance
        triangle = hits.triangle[solid]
        points = origins[solid] + directions[solid] * hits.range_m[solid][:, None]
        frames = self._frames.take(triangle, axis=0)
        u, v = np.einsum("nij,nj->in", frames[..., :3], points) + frames[..., 3].T
        weights = hits.barycentric[solid]
        corner = self._lambert.take(triangle, axis=0)
        lambert = corner[:, 0] + weights[:, 0] * (corner[:, 1] - corner[:, 0])
        lambert += weights[:, 1] * (corner[:, 2] - corner[:, 0])
        axes_cosines = np.einsum("nij,nj->in", frames[..., :3], directions[solid])
        slant = np.sqrt(np.clip(1 - (axes_cosines**2).sum(axis=0), 0.02, 1))
        footprint = path_m[solid] * ray_width_rad / np.sqrt(slant)
        tone = compute_reflectance(
            self._noise_atlas,
            self._materials.take(triangle),
            self._keys.take(triangle),
            u,
            v,
            footprint,
        )
        sunlit = lambert * ~self._find_shadowed(points, lambert)
        ambient = AMBIENT * (1 + 0.25 * self._upward.take(triangle))
        radiance[solid] = tone * (ambient + SUNLIGHT * sunlit)
        return radiance

    def _find_shadowed(self, points: FloatMap, lambert: FloatMap) -> NDArray[np.bool_]:
        shadowed = np.zeros(len(points), dtype=bool)
        lit = np.flatnonzero(lambert > 0)
        rays = np.empty((len(lit), 6), dtype=np.float32)
        rays[:, :3] = points[lit] + SURFACE_M * self._sun
        rays[:, 3:] = self._sun
        tensor = self._o3d.core.Tensor(rays)
        shadowed[lit] = self._rays.test_occlusions(tensor, nthreads=1, tnear=0.02).numpy()
        return shadowed

    def _sky_radiance(self, directions: FloatMap) -> FloatMap:
        if not self._sky:
            return np.zeros(len(directions), dtype=np.float32)
        height = np.clip(directions[:, 2], 0, 1)
        spread = (3 / (height + 0.25)).astype(np.float32)
        clouds = self._noise_atlas.sample_texture(
            directions[:, 0] * spread,
            directions[:, 1] * spread,
            CLOUDS,
            np.full(len(directions), 0.01, dtype=np.float32),
        )
        return np.asarray(0.8 - 0.3 * height + 0.035 * clouds, dtype=np.float32)
