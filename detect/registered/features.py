"""What a network is shown of a measurement: channels of about unit size."""

from typing import Literal, get_args

import numpy as np

from detect.registered.registration import Measurement
from geometry.arrays import FloatMap

Feature = Literal[
    "displacement_x",
    "displacement_y",
    "first_displacement_x",
    "first_displacement_y",
    "significance_x",
    "significance_y",
    "log_sigma",
    "log_scatter",
    "log_texture",
    "log_misfit",
    "log_depth_edge",
    "visible",
    "inverse_depth",
]
FEATURES: tuple[Feature, ...] = get_args(Feature)
SMALL_PX = 0.1
"""Unit of displacements and sigmas."""
UNMEASURED_SIGMA_PX = 3.0
"""In place of an infinite sigma."""
NEIGHBOURS = 8.0
"""Unit of the number of neighbours that see a pixel."""
LOG_UNIT = 3.0
"""Unit of the logarithms of texture and misfit."""
LEAST_SCATTER_PX = 1e-3
"""Added, so that no scatter has a logarithm."""
Plain = Literal[
    "displacement_x", "displacement_y", "log_sigma", "log_texture", "log_depth_edge", "visible"
]


def stack_features(measurement: Measurement, sigma_px: FloatMap) -> FloatMap:
    """The channels, in the order of `FEATURES`.

    Displacements enter as arcsinh(w / 0.1 px), and again in units of their sigma; everything with
    a scale as a logarithm.

    Args:
        measurement: (H, W) of one frame.
        sigma_px: (H, W) of the displacement; inf where unmeasured.

    Returns:
        (C, H, W) float32.
    """
    sigma = np.where(np.isfinite(sigma_px), sigma_px, UNMEASURED_SIGMA_PX)
    w = measurement.displacement
    channels = [
        *np.moveaxis(np.arcsinh(w / SMALL_PX), -1, 0),
        *np.moveaxis(np.arcsinh(measurement.first_displacement / SMALL_PX), -1, 0),
        *np.moveaxis(np.arcsinh(w / sigma[..., None]), -1, 0),
        np.log(sigma / SMALL_PX),
        np.log((measurement.scatter_px + LEAST_SCATTER_PX) / SMALL_PX),
        np.log1p(measurement.texture) / LOG_UNIT,
        np.log1p(measurement.misfit) / LOG_UNIT,
        np.log1p(measurement.depth_edge_px),
        measurement.visible / NEIGHBOURS,
        np.log1p(measurement.relative_inverse_depth),
    ]
    return np.stack(channels, dtype=np.float32)


def decode_feature(inputs: FloatMap, name: Plain) -> FloatMap:
    """(H, W) what a channel of (C, H, W) was made of, in the unit of `Measurement`; sigma in px."""
    channel = inputs[FEATURES.index(name)].astype(np.float32)
    plain = {
        "displacement_x": lambda: np.sinh(channel) * SMALL_PX,
        "displacement_y": lambda: np.sinh(channel) * SMALL_PX,
        "log_sigma": lambda: np.exp(channel) * SMALL_PX,
        "log_texture": lambda: np.expm1(channel * LOG_UNIT),
        "log_depth_edge": lambda: np.expm1(channel),
        "visible": lambda: channel * NEIGHBOURS,
    }
    return np.asarray(plain[name](), dtype=np.float32)
