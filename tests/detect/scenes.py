"""A scene with exact sub-pixel positions: textures are functions, evaluated where rays land."""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from detect.detection import Frames
from geometry.arrays import GreyImage
from geometry.camera import Camera
from geometry.trajectory import Trajectory


class Texture:
    """A sum of plane waves, so it can be read anywhere."""

    def __init__(self, seed: int, finest: float, waves: int = 30) -> None:
        rng = np.random.default_rng(seed)
        angle = rng.uniform(0, 2 * np.pi, waves)
        wavenumber = finest * np.exp(rng.uniform(np.log(0.05), 0, waves))
        self.kx, self.ky = wavenumber * np.cos(angle), wavenumber * np.sin(angle)
        self.phase = rng.uniform(0, 2 * np.pi, waves)

    def __call__(self, x: NDArray, y: NDArray) -> NDArray:
        waves = zip(self.kx, self.ky, self.phase, strict=True)
        return 128 + 9 * sum(np.sin(kx * x + ky * y + phase) for kx, ky, phase in waves)


def photographed(light: NDArray, seed: int, noise: float = 1.0) -> GreyImage:
    noisy = light + np.random.default_rng(seed).normal(0, noise, light.shape)
    return np.clip(noisy.round(), 0, 255).astype(np.uint8)


def ring_displacement(shape: tuple[int, int], peak_px: float, radius_px: float) -> NDArray:
    """The gradient of a Gaussian bump in the image centre: a lens of warm air."""
    y, x = np.mgrid[: shape[0], : shape[1]].astype(float)
    dx, dy = (x - shape[1] / 2) / radius_px, (y - shape[0] / 2) / radius_px
    bump = np.exp(0.5 - (dx**2 + dy**2) / 2)
    return peak_px * np.stack([dx * bump, dy * bump], axis=-1)


@dataclass(frozen=True, kw_only=True)
class TwoWalls:
    """A far wall behind a near pillar, filmed sideways; the plume is in the key frame only."""

    frames: Frames
    key: int
    displacement: NDArray
    depth: NDArray


def two_walls(*, peak_px: float, unit: float = 1.0, sky: bool = False) -> TwoWalls:
    camera = Camera.pinhole(160, 120, 140.0)
    count, far_z, near_z = 13, 12.0, 7.0
    key = count // 2
    centers = np.zeros((count, 3))
    centers[:, 0] = 0.35 * (np.arange(count) - key)
    rng = np.random.default_rng(5)
    rotations = np.array([cv2.Rodrigues(rng.normal(0, 0.004, 3))[0] for _ in range(count)])
    far, near = Texture(1, 9.0), Texture(2, 12.0)
    still = np.zeros((camera.height, camera.width, 2))
    lens = ring_displacement(still.shape[:2], peak_px, 14.0)
    images, depths = [], []
    for i in range(count):
        displacement = lens if i == key else still
        pixels = camera.pixel_grid() + displacement
        rays = camera.rays(pixels) @ rotations[i]
        far_points = centers[i] + rays * (far_z / rays[..., 2:])
        near_points = centers[i] + camera.rays(camera.pixel_grid()) @ rotations[i] * (
            near_z / (camera.rays(camera.pixel_grid()) @ rotations[i])[..., 2:]
        )
        pillar = np.abs(near_points[..., 0] - 2.6) < 0.5
        light = np.where(
            pillar,
            near(near_points[..., 0], near_points[..., 1]),
            far(far_points[..., 0], far_points[..., 1]),
        )
        if sky:
            light = np.where(np.arange(camera.height)[:, None] < 30, 230.0, light)
        images.append(photographed(light, seed=i))
        depths.append(np.where(pillar, near_z, far_z))
    trajectory = Trajectory(
        camera=camera,
        indices=np.arange(count),
        times_s=np.arange(count) / 15,
        rotations=rotations,
        translations=-unit * np.einsum("nij,nj->ni", rotations, centers),
    )
    frames = Frames(images=images, trajectory=trajectory)
    return TwoWalls(frames=frames, key=key, displacement=lens, depth=unit * depths[key])
