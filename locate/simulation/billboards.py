"""Photos on flat billboards, cut out, standing, swaying or walking, in front of other surfaces.

A billboard's radiance is a fixed function of the place on it, so nothing in a rendered image says
whether the ray that fetched it was bent.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Self

import cv2
import numpy as np

from geometry.arrays import BoolArray, FloatArray, FloatMap
from locate.simulation.surfaces import RayHits, SurfaceModel
from locate.simulation.textures import GRAIN, TEXEL_M, TextureAtlas

FIRST_BILLBOARD = 2**31
NEAREST_M = 0.05
SWAY_WAVE_M = 0.7
WAVELET_M = 3.0
SPARKLE = 0.05
WAVES_SLOPE = 0.25


@dataclass(frozen=True, kw_only=True)
class Billboard:
    """A photo, repeated as in mirrors, on a rectangle.

    Attributes:
        corner: (3,) its lower left corner at time 0, m, world.
        right: (3,) unit vector of its u axis.
        up: (3,) unit vector of its v axis, across `right`.
        size_m: Width and height; inf reaches both ways.
        photo: Number of its photo.
        texel_m: Width of a pixel of the photo on it.
        cover: Solid where positive, clear elsewhere, stretched over it; None is all solid.
        velocity_mps: (3,) how it moves.
        sway_m: By how much wind moves it in its own plane, each place in its own time.
        sway_hz: How often.
        gloss: Brightness of its glints.
        lamp: (3,) unit vector to the light that glints.
    """

    corner: FloatArray
    right: FloatArray
    up: FloatArray
    size_m: tuple[float, float] = (np.inf, np.inf)
    photo: int = 0
    texel_m: float = 0.01
    cover: FloatMap | None = None
    velocity_mps: FloatArray = field(default_factory=lambda: np.zeros(3))
    sway_m: float = 0.0
    sway_hz: float = 1.0
    gloss: float = 0.0
    lamp: FloatArray = field(default_factory=lambda: np.array([0.0, 0.0, 1.0]))

    @property
    def normal(self) -> FloatArray:
        """(3,) unit vector towards whoever sees `right` on the right and `up` above."""
        return np.cross(self.right, self.up)

    def at(self, time_s: float) -> Self:
        """The billboard where it then is."""
        return replace(self, corner=self.corner + self.velocity_mps * time_s)

    def to_billboard_axes(
        self, origins: FloatMap, directions: FloatMap
    ) -> tuple[FloatMap, FloatMap]:
        """(N, 3) rays in the billboard's own axes right, up and normal: where from, which way."""
        axes = np.array([self.right, self.up, self.normal], dtype=np.float32).T
        return (origins - self.corner.astype(np.float32)) @ axes, directions @ axes

    def unsway(self, u: FloatMap, v: FloatMap, time_s: float) -> tuple[FloatMap, FloatMap]:
        """Which place of the billboard the wind has moved to (u, v), m."""
        if not self.sway_m:
            return u, v
        beat = 2 * np.pi * self.sway_hz * time_s
        phase = np.float32(beat) + np.sin(np.float32(0.37 * beat) + u)
        moved_u = u + np.float32(self.sway_m) * np.sin(phase + v / SWAY_WAVE_M)
        moved_v = v + np.float32(self.sway_m / 2) * np.sin(np.float32(1.7 * beat) + u / SWAY_WAVE_M)
        return moved_u.astype(np.float32), moved_v.astype(np.float32)

    def stops_ray(self, u: FloatMap, v: FloatMap) -> BoolArray:
        """(N,) where a ray at (u, v) is stopped."""
        width, height = self.size_m
        inside = np.ones(u.shape, bool)
        if np.isfinite(width):
            inside &= (u > 0) & (u < width)
        if np.isfinite(height):
            inside &= (v > 0) & (v < height)
        if self.cover is not None and inside.any():
            x = u[inside] / width * (self.cover.shape[1] - 1)
            y = (1 - v[inside] / height) * (self.cover.shape[0] - 1)
            inside[inside] = _read_cover(self.cover, x, y) > 0
        return inside


def stand_billboard(
    x: float, y: float, z: float, yaw_deg: float = 0.0, **attributes: Any
) -> Billboard:
    """A billboard with its lower left corner at (x, y, z), m, that faces -y, then turned."""
    turn = np.radians(yaw_deg)
    return Billboard(
        corner=np.array([x, y, z]),
        right=np.array([np.cos(turn), np.sin(turn), 0.0]),
        up=np.array([0.0, 0.0, 1.0]),
        **attributes,
    )


def lay_billboard(x: float, y: float, z: float, **attributes: Any) -> Billboard:
    """A billboard that lies at height z, its corner of least x and y at (x, y), m."""
    right, up = np.array([1.0, 0.0, 0.0]), np.array([0.0, 1.0, 0.0])
    return Billboard(corner=np.array([x, y, z]), right=right, up=up, **attributes)


class BillboardSurfaces:
    """Billboards in front of other surfaces.

    Args:
        billboards: The billboards.
        photos: Their pictures, as radiance, 1 is white.
        behind: What is seen between them.
        waves: Noise for the slopes of what glints.
        time_s: The moment.
    """

    def __init__(
        self,
        billboards: Sequence[Billboard],
        photos: TextureAtlas,
        behind: SurfaceModel,
        waves: TextureAtlas | None = None,
        time_s: float = 0.0,
    ) -> None:
        self._billboards_at_start = tuple(billboards)
        self._billboards = tuple(billboard.at(time_s) for billboard in billboards)
        self._photos = photos
        self._behind = behind
        self._wave_noise = waves
        self._time_s = time_s

    def at(self, time_s: float) -> Self:
        """The billboards where they then are."""
        behind = self._behind.at(time_s)
        return type(self)(self._billboards_at_start, self._photos, behind, self._wave_noise, time_s)

    def cast_rays(self, origins: FloatMap, directions: FloatMap) -> RayHits:
        """Follows N rays, (N, 3) origins and unit directions, to the first surface."""
        hits = self._behind.cast_rays(origins, directions)
        nearest, triangle = hits.range_m.copy(), hits.triangle.copy()
        for number, billboard in enumerate(self._billboards):
            start, step = billboard.to_billboard_axes(origins, directions)
            with np.errstate(divide="ignore", invalid="ignore"):
                ranges = -start[:, 2] / step[:, 2]
            rows = np.flatnonzero((ranges > NEAREST_M) & (ranges < nearest))
            reach = ranges[rows]
            u, v = (start[rows, axis] + reach * step[rows, axis] for axis in (0, 1))
            solid = billboard.stops_ray(*billboard.unsway(u, v, self._time_s))
            nearest[rows[solid]] = reach[solid]
            triangle[rows[solid]] = FIRST_BILLBOARD + number
        return RayHits(range_m=nearest, triangle=triangle, barycentric=hits.barycentric)

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

        For the arguments see `StaticSurfaces.compute_radiance`.
        """
        on_billboard = np.isfinite(hits.range_m) & (hits.triangle >= FIRST_BILLBOARD)
        rest = np.flatnonzero(~on_billboard)
        radiance = np.empty(len(directions), dtype=np.float32)
        behind = RayHits(
            range_m=hits.range_m[rest],
            triangle=hits.triangle[rest],
            barycentric=hits.barycentric[rest],
        )
        radiance[rest] = self._behind.compute_radiance(
            origins[rest],
            directions[rest],
            behind,
            path_m=path_m[rest],
            ray_width_rad=ray_width_rad,
        )
        for number, billboard in enumerate(self._billboards):
            rows = np.flatnonzero(on_billboard & (hits.triangle == FIRST_BILLBOARD + number))
            if len(rows):
                start, step = billboard.to_billboard_axes(origins[rows], directions[rows])
                place = start + step * hits.range_m[rows, None]
                slant = np.sqrt(np.abs(step[:, 2]).clip(0.02))
                radiance[rows] = self._shade_billboard(
                    billboard, place, step, path_m[rows] * ray_width_rad / slant
                )
        return radiance

    def _shade_billboard(
        self, billboard: Billboard, place: FloatMap, step: FloatMap, footprint: FloatMap
    ) -> FloatMap:
        """(N,) radiance at (N, 3) places for rays (N, 3), both in the billboard's axes."""
        u, v = billboard.unsway(place[:, 0], place[:, 1], self._time_s)
        fine = np.float32(TEXEL_M / billboard.texel_m)
        tone = self._photos.sample_texture(u * fine, v * fine, billboard.photo, footprint * fine)
        tone = np.clip(tone, 0, 1)
        if billboard.gloss and self._wave_noise is not None:
            tone = tone + billboard.gloss * self._glint_brightness(
                billboard, self._wave_noise, u, v, step, footprint
            )
        return np.asarray(tone, dtype=np.float32)

    def _glint_brightness(
        self,
        billboard: Billboard,
        waves: TextureAtlas,
        u: FloatMap,
        v: FloatMap,
        step: FloatMap,
        footprint: FloatMap,
    ) -> FloatMap:
        """(N,) bright where a wavelet mirrors the lamp towards the camera."""
        axes = np.array([billboard.right, billboard.up, billboard.normal], dtype=np.float32)
        half = axes @ billboard.lamp.astype(np.float32) - step
        slopes = half[:, :2] / np.maximum(np.abs(half[:, 2:]), 1e-3)
        passed = np.float32(0.2 * self._time_s)
        tilt_u = WAVES_SLOPE * waves.sample_texture(u / WAVELET_M, v, GRAIN, footprint)
        tilt_v = WAVES_SLOPE * waves.sample_texture(v + passed, u / WAVELET_M, GRAIN, footprint)
        off = (slopes[:, 0] - tilt_u) ** 2 + (slopes[:, 1] - tilt_v) ** 2
        return np.asarray(np.exp(-off / (2 * SPARKLE**2)))


def _read_cover(cover: FloatMap, x: FloatMap, y: FloatMap) -> FloatMap:
    """The cover between its pixels, linearly; any number of places."""
    width = 1024
    spare = -len(x) % width
    grid = [np.pad(a, (0, spare)).reshape(-1, width).astype(np.float32) for a in (x, y)]
    values = cv2.remap(cover, grid[0], grid[1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    return np.asarray(values.ravel()[: len(x)])
