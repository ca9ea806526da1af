"""A first ``target_from_source`` that outliers do not move."""

import numpy as np

from geometry.arrays import FloatArray
from geometry.similarity import Similarity, align_points

TRIALS = 100
"""Random triples; one of them is free of outliers almost surely while these are under half."""
SAMPLE = 3
"""Points of a triple."""
SEED = 0


def align_by_least_median(
    source: FloatArray, target: FloatArray, up: FloatArray | None
) -> Similarity:
    """The similarity with the least median residual over random triples, refitted to its half.

    Source: Rousseeuw, Least Median of Squares Regression, JASA 1984.

    Args:
        source: (N, 3), N >= 3 (2 where `up` is known).
        target: (N, 3).
        up: (3,) direction of up in the source; None where it is to be found too.
    """
    random = np.random.default_rng(SEED)
    size = min(SAMPLE, len(source))
    rows = [random.choice(len(source), size=size, replace=False) for _ in range(TRIALS)]
    fits = [_align_given_up(source[few], target[few], up) for few in rows]
    errors = np.array([np.linalg.norm(fit(source) - target, axis=1) for fit in fits])
    best = errors[np.argmin(np.median(errors, axis=1))]
    half = np.argsort(best)[: max(size, (len(source) + 1) // 2 + 1)]
    return _align_given_up(source[half], target[half], up)


def rotation_to_upright(up: FloatArray) -> FloatArray:
    """The smallest (3, 3) rotation that turns `up` to +Z."""
    axis, cosine = np.cross(up, [0.0, 0.0, 1.0]), float(up[2])
    if cosine < -1 + 1e-12:
        return np.diag([1.0, -1.0, -1.0])
    cross = np.array([[0, -axis[2], axis[1]], [axis[2], 0, -axis[0]], [-axis[1], axis[0], 0]])
    return np.asarray(np.eye(3) + cross + cross @ cross / (1 + cosine))


def _align_given_up(source: FloatArray, target: FloatArray, up: FloatArray | None) -> Similarity:
    return align_points(source, target) if up is None else _align_upright(source, target, up)


def _align_upright(source: FloatArray, target: FloatArray, up: FloatArray) -> Similarity:
    """Least squares over scale, heading and origin: horizontal positions as complex numbers."""
    upright = rotation_to_upright(up)
    level = source @ upright.T
    level_mean, target_mean = level.mean(axis=0), target.mean(axis=0)
    p, q = (
        (points - mean)[:, :2] @ [1, 1j]
        for points, mean in ((level, level_mean), (target, target_mean))
    )
    turn = np.vdot(p, q) / max(np.vdot(p, p).real, 1e-300)
    scale, (c, s) = max(abs(turn), 1e-12), (np.cos(np.angle(turn)), np.sin(np.angle(turn)))
    rotation = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]) @ upright
    translation = target_mean - scale * rotation @ source.mean(axis=0)
    return Similarity(scale=scale, rotation=rotation, translation=translation)
