"""From a displacement and its sigma to a log-likelihood ratio, by hand.

Every step is a function of its own, so that a learned score can stand in for any of them.
"""

import numpy as np

from detect.warp import blur
from geometry.arrays import BoolArray, FloatMap

LLR_MIN, LLR_MAX = -1.5, 4.0
"""Bounds of the evidence of a pixel, nats; chosen by hand."""
POOLED_MOST = 6.0
"""Upper bound before neighbouring pixels are averaged, nats; chosen by hand."""
POOL_PX = 5.0
"""Standard deviation of the window of that average, px; chosen by hand."""
POOL_LONELY = 0.05
"""Added to its weights, so that few trusted pixels give little evidence; chosen by hand."""
AMPLITUDES_PX = (0.05, 0.1, 0.2, 0.4, 0.8, 1.6)
"""Standard deviations of w in a plume, each as likely as the others."""
NULL_FREEDOM = 3.0
"""Degrees of freedom of the Student t of flow errors; chosen by hand."""
TEXTURE_CLASSES = 5
"""Of equal size, each with a scale of sigma of its own."""
TEXTURE_HALF = 1.5
"""Texture with which evidence counts half, (grey levels per px) squared; chosen by hand."""
NULL_QUANTILE = 0.3
"""Of |w| / sigma, which is compared with that of still air: few plume pixels lie below."""
RAYLEIGH_AT_QUANTILE = float(np.sqrt(-2 * np.log(1 - NULL_QUANTILE)))
"""That of still air: the length of a normal vector follows Rayleigh's distribution."""
SMALLEST_CLASS = 200
"""Pixels that a scale is taken from, at least."""
LEAST_SCALE = 0.5
"""By which sigma is multiplied."""


def displacement_evidence(
    displacement: FloatMap,
    sigma_px: FloatMap,
    texture: FloatMap,
    trust: FloatMap,
    *,
    largest_scale: float = np.inf,
) -> tuple[FloatMap, FloatMap]:
    """Evidence of refraction at every pixel, and a sigma that fits the frame's own scatter.

    Args:
        displacement: (H, W, 2) w, px.
        sigma_px: (H, W) its standard deviation as first estimated; inf where unmeasured.
        texture: (H, W) mean squared gradient, (grey levels per px) squared.
        trust: (H, W) from 0 (no evidence) to 1.
        largest_scale: Up to what factor the frame's scatter may widen sigma.

    Returns:
        (H, W) llr in nats, from -1.5 to 4, 0 where there is none; (H, W) sigma_px.
    """
    size = np.hypot(displacement[..., 0], displacement[..., 1])
    measured = np.isfinite(sigma_px) & (trust > 0)
    scale = null_scale(size, sigma_px, texture, measured)
    sigma_px = sigma_px * np.minimum(scale, largest_scale)
    llr = log_likelihood_ratio(size, np.where(measured, sigma_px, 1.0).astype(np.float32))
    trust = np.where(measured, trust, 0).astype(np.float32)
    llr = pool_evidence(np.clip(llr, LLR_MIN, POOLED_MOST), trust)
    llr = llr * texture / (texture + TEXTURE_HALF) * trust
    llr = np.where(measured, np.clip(llr, LLR_MIN, LLR_MAX), 0)
    return llr.astype(np.float32), sigma_px.astype(np.float32)


def null_scale(
    size_px: FloatMap, sigma_px: FloatMap, texture: FloatMap, measured: BoolArray
) -> FloatMap:
    """By what to multiply sigma so that the calmer pixels scatter as stated.

    Plumes cover the smaller part of a frame, so its lower quantiles hold none: an empirical null
    (Efron, JASA 2004), per class of texture. Never below one half.
    """
    if measured.sum() < SMALLEST_CLASS:
        return np.ones_like(sigma_px)
    edges = np.quantile(texture[measured], np.linspace(0, 1, TEXTURE_CLASSES + 1)[1:-1])
    classes = sum((texture >= edge).astype(np.uint8) for edge in edges)
    ratios, kinds = size_px[measured] / sigma_px[measured], classes[measured]
    scales = np.ones(TEXTURE_CLASSES, sigma_px.dtype)
    for k in range(TEXTURE_CLASSES):
        sample = ratios[kinds == k]
        if len(sample) >= SMALLEST_CLASS:
            quantile = float(np.quantile(sample, NULL_QUANTILE))
            scales[k] = max(quantile / RAYLEIGH_AT_QUANTILE, LEAST_SCALE)
    return np.asarray(scales[classes])


def pool_evidence(llr: FloatMap, trust: FloatMap) -> FloatMap:
    """The trusted mean round every pixel: plumes are wide, errors at edges are thin."""
    shared = blur((llr * trust).astype(np.float32), POOL_PX)
    return np.asarray(shared / (blur(trust, POOL_PX) + POOL_LONELY))


def log_likelihood_ratio(size_px: FloatMap, sigma_px: FloatMap) -> FloatMap:
    """Refraction of unknown strength against a heavy-tailed null, unclipped, nats.

    Refraction: w normal with variance a^2 + sigma^2 per component, a log-uniform. None: a
    bivariate Student t with 3 degrees of freedom, for flow errors have tails.
    """
    square, variance = size_px**2, sigma_px**2
    wide = [variance + amplitude**2 for amplitude in AMPLITUDES_PX]
    densities = [np.exp(-square / (2 * v)) / v for v in wide]
    refraction = np.mean(densities, axis=0) / (2 * np.pi)
    tail = (1 + square / (NULL_FREEDOM * variance)) ** (-NULL_FREEDOM / 2 - 1)
    none = tail / (2 * np.pi * variance)
    return np.asarray(np.log(refraction + 1e-30) - np.log(none + 1e-30), dtype=np.float32)
