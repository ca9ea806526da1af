"""Similarity transforms (scale, rotation, translation) and their estimation from point pairs."""

from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import ArrayLike

from geometry.arrays import FloatArray


@dataclass(frozen=True, kw_only=True)
class Similarity:
    """``target_from_source``: x_target = scale * rotation @ x_source + translation."""

    scale: float
    rotation: FloatArray
    translation: FloatArray

    def __call__(self, points: ArrayLike) -> FloatArray:
        """Transforms (..., 3) points."""
        moved = self.scale * np.asarray(points, dtype=float) @ self.rotation.T + self.translation
        return np.asarray(moved)

    def inverse(self) -> Self:
        """``source_from_target``."""
        rotation = self.rotation.T
        return type(self)(
            scale=1 / self.scale,
            rotation=rotation,
            translation=-(rotation @ self.translation) / self.scale,
        )

    def transform_covariance(self, covariance: ArrayLike) -> FloatArray:
        """Carries (..., 3, 3) position covariances into the target frame."""
        turned = self.rotation @ np.asarray(covariance, dtype=float) @ self.rotation.T
        return np.asarray(self.scale**2 * turned)


def align_points(source: ArrayLike, target: ArrayLike, *, fix_scale: bool = False) -> Similarity:
    """Least-squares ``target_from_source`` between (N, 3) point pairs.

    Source: Umeyama, PAMI 1991, eq. 40 to 42.

    Args:
        source: (N, 3) points, N >= 3, not on one line.
        target: (N, 3) their partners.
        fix_scale: Keep scale 1 (both frames are metric).

    Raises:
        ValueError: The arrays differ in shape or hold fewer than three points.
    """
    source, target = np.asarray(source, dtype=float), np.asarray(target, dtype=float)
    if source.shape != target.shape or source.ndim != 2 or len(source) < 3:
        raise ValueError(f"{source.shape=} and {target.shape=}, expected (N >= 3, 3) twice")
    source_mean, target_mean = source.mean(axis=0), target.mean(axis=0)
    source_0, target_0 = source - source_mean, target - target_mean
    u, singular, vt = np.linalg.svd(target_0.T @ source_0 / len(source))
    sign = np.ones(3)
    if np.linalg.det(u) * np.linalg.det(vt) < 0:
        sign[2] = -1
    rotation = u @ np.diag(sign) @ vt
    variance = (source_0**2).sum() / len(source)
    scale = 1.0 if fix_scale else float((singular * sign).sum() / variance)
    translation = target_mean - scale * rotation @ source_mean
    return Similarity(scale=scale, rotation=rotation, translation=translation)
