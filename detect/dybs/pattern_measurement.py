"""What waves and edges measure in one frame, as channels for the network that refines it."""

from dataclasses import dataclass

import numpy as np

from detect.dybs.demodulation import demodulate_halved
from detect.dybs.edges import measure_edges
from detect.texture import Classes, Texture
from geometry.arrays import BoolArray, FloatMap, GreyImage

CHANNELS = 12
VECTORS, TENSOR = ((0, 1), (2, 3), (4, 5), (6, 7)), (8, 9, 10)
"""Which channels turn with the image."""
SMALL_PX = 0.1
SIGNIFICANT, CERTAIN = 3.0, 5.0
"""Scales that bring channels to about unit size."""


@dataclass(frozen=True, kw_only=True)
class PatternMeasurement:
    """What waves and edges measure, at half the image's resolution.

    Attributes:
        displacement: (H/2, W/2, 2) px, x right, y down; across lines or edges alone where there is
            no other direction.
        own: (H/2, W/2, 2) the same, of edges off their own lines alone.
        information: (H/2, W/2, 3) xx, xy and yy of the inverse covariance, 1 / px^2; 0 where
            nothing is known.
        length: (H/2, W/2) of the edges, 1 at 128 px; 0 for waves.
        lattice: (H/2, W/2) where waves are measured.
        reliable: (H/2, W/2) where straight edges are reliable.
    """

    displacement: FloatMap
    own: FloatMap
    information: FloatMap
    length: FloatMap
    lattice: BoolArray
    reliable: BoolArray

    @property
    def certainty(self) -> FloatMap:
        """(H/2, W/2) trace of the information."""
        return np.asarray(self.information[..., 0] + self.information[..., 2])


def measure_pattern(image: GreyImage, texture: Classes) -> PatternMeasurement:
    """Measures the waves of an image and, where there are none, its straight edges.

    Args:
        image: (H, W) grey values.
        texture: (H, W) of `Texture`; an image without `LATTICE` and `STRAIGHT` is not measured.
    """
    waves = demodulate_halved(image, texture == Texture.LATTICE)
    lattice = waves[..., 2] + waves[..., 4] > 0
    half = texture[::2, ::2]
    maps = np.zeros((*waves.shape[:2], 9), np.float32)
    if ((half == Texture.STRAIGHT) | ((half == Texture.LATTICE) & ~lattice)).any():
        maps = measure_edges(image)
    nothing = np.zeros_like(waves[..., :2])
    maps[lattice] = np.concatenate([waves[..., :2], waves, nothing], axis=-1)[lattice]
    return PatternMeasurement(
        displacement=maps[..., :2],
        own=maps[..., 2:4],
        information=maps[..., 4:7],
        length=maps[..., 7],
        lattice=lattice,
        reliable=maps[..., 8] > 0,
    )


def network_channels(measured: PatternMeasurement) -> FloatMap:
    """(C, H/2, W/2) of about unit size: displacements, significance, information, length."""
    total = measured.certainty[..., None]
    displacements = np.concatenate([measured.displacement, measured.own], axis=-1)
    parts = [
        np.arcsinh(displacements / SMALL_PX),
        np.arcsinh(displacements * np.sqrt(total)) / SIGNIFICANT,
        measured.information / (total + 1e-9) * np.log1p(total * SMALL_PX**2) / CERTAIN,
        measured.length[..., None],
    ]
    planes = np.moveaxis(np.concatenate(parts, axis=-1), -1, 0)
    return np.ascontiguousarray(planes, dtype=np.float32)
