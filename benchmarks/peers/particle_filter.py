"""A particle filter on the lowest point of each mask, view after view.

In the manner of Pesonen, Solin & Honkavaara (arXiv 2509.20906, 2026), who weigh particles by the
masks of a distant object; its source is asked for here, so they are weighed by the lowest point.
"""

import numpy as np

from benchmarks.peers.blobs import SourceEstimate
from geometry.arrays import FloatArray
from geometry.grid import VoxelBox
from geometry.trajectory import Trajectory

PARTICLES = 20_000
SIGMA_PX = 4.0
"""Of a mark; that of the masks' own noise is unknown to such a filter."""
OUTLIERS = 0.3
"""Share of marks that are something else."""
JITTER_SHARE = 0.2
"""Of the cloud's own deviation, added where particles are drawn again."""
ENOUGH = 0.5
"""Share of effective particles below which they are drawn again."""


def filter_particles(
    trajectory: Trajectory, pixels: FloatArray, box: VoxelBox, rng: np.random.Generator
) -> SourceEstimate | None:
    """Mean and covariance of the cloud after all views; None without any mark.

    Args:
        trajectory: V poses.
        pixels: (V, 2) a point in each view; NaN where it has none.
        box: Where the particles start, evenly.
        rng: Draws them.
    """
    rows = np.flatnonzero(np.isfinite(pixels).all(axis=1))
    if not len(rows):
        return None
    size = np.array(box.shape[::-1]) * box.voxel
    cloud = box.low_in_world + rng.random((PARTICLES, 3)) * size
    weights = np.full(PARTICLES, 1 / PARTICLES)
    height, width = trajectory.camera.height, trajectory.camera.width
    for i in rows:
        in_cam = trajectory.world_to_cam(int(i), cloud)
        ahead = in_cam[:, 2] > 0
        away = np.full((PARTICLES, 2), np.inf)
        away[ahead] = trajectory.camera.project(in_cam[ahead]) - pixels[i]
        density = np.exp(-(away**2).sum(axis=1) / 2 / SIGMA_PX**2) / (2 * np.pi * SIGMA_PX**2)
        weights *= (1 - OUTLIERS) * density + OUTLIERS / (width * height)
        weights /= weights.sum()
        if 1 / (weights**2).sum() < ENOUGH * PARTICLES:
            cloud, weights = _draw_again(cloud, weights, rng)
    mean = weights @ cloud
    off = cloud - mean
    return SourceEstimate(source=mean, covariance=(off * weights[:, None]).T @ off)


def _draw_again(
    cloud: FloatArray, weights: FloatArray, rng: np.random.Generator
) -> tuple[FloatArray, FloatArray]:
    """Systematic resampling; the cloud is drawn together by as much as the jitter widens it."""
    places = (rng.random() + np.arange(PARTICLES)) / PARTICLES
    drawn = cloud[np.searchsorted(np.cumsum(weights), places).clip(max=PARTICLES - 1)]
    mean = drawn.mean(axis=0)
    deviation = np.linalg.cholesky(np.cov(drawn.T) + 1e-12 * np.eye(3))
    jitter = JITTER_SHARE * rng.normal(size=drawn.shape) @ deviation.T
    drawn = mean + np.sqrt(1 - JITTER_SHARE**2) * (drawn - mean) + jitter
    return drawn, np.full(PARTICLES, 1 / PARTICLES)
