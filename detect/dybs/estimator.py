"""One frame's displacement and scores by networks, waves and straight edges."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

import cv2
import numpy as np

from detect.dybs.edge_reliability import select_edges
from detect.dybs.pattern_measurement import PatternMeasurement, measure_pattern
from detect.dybs.refinement import RefinementNetwork
from detect.network import Maps, Network
from detect.texture import Classes, Texture, texture_classes
from geometry.arrays import BoolArray, FloatMap, GreyImage
from geometry.errors import BadInputError

WHITE = 255.0
OUTPUTS = {"displacement": 2, "log_variance": 1, "logit": 1}
MEASURABLE = (Texture.LATTICE, Texture.STRAIGHT)
PRIOR_CERTAINTY = 1500.0
"""1 / px^2, of the network without any image: by how large plumes mostly are, which the refinement
has learned, too. Chosen on validation samples; px of the network's own image."""


@dataclass(frozen=True, kw_only=True)
class Estimate:
    """What the networks estimate in an image.

    Attributes:
        displacement: (H, W, 2) px of both, weighted by their inverse variances.
        sigma_px: (H, W) of either component.
        texture: (H, W) of `Texture`.
        scores: (H, W, 2), the network's logit and the refinement's: higher means refraction.
    """

    displacement: FloatMap
    sigma_px: FloatMap
    texture: Classes
    scores: FloatMap


@dataclass(frozen=True, kw_only=True)
class RefinedMeasurement:
    """What waves and straight edges measure in an image, refined by a network.

    Attributes:
        texture: (H, W) of `Texture`; a lattice without measurable waves counts as straight, and
            unreliable straight edges as irregular.
        measured: Waves and edges.
        refined: Displacement, log-variance and logit at full size; None where there is neither.
    """

    texture: Classes
    measured: PatternMeasurement
    refined: Maps | None

    @classmethod
    def of_image(cls, image: GreyImage, refine: RefinementNetwork) -> Self:
        """Measures an image, (H, W)."""
        texture = texture_classes(image)
        measured = measure_pattern(image, texture)
        waves = enlarge_mask(measured.lattice, image.shape)
        texture[(texture == Texture.LATTICE) & ~waves] = Texture.STRAIGHT
        straight = texture == Texture.STRAIGHT
        if straight.any():
            counts = select_edges(straight[::2, ::2], measured.reliable, measured.lattice)
            texture[straight & ~enlarge_mask(counts, image.shape)] = Texture.IRREGULAR
        refined = refine(measured, image.shape) if np.isin(texture, MEASURABLE).any() else None
        return cls(texture=texture, measured=measured, refined=refined)


class SingleFrameEstimator:
    """A network over the image, and one that refines what its waves and straight edges measure.

    Args:
        weights: The .onnx file of the former. Its metadata may hold `scale`: the size of the image
            that it takes, as a share of the frame's.

    Attributes:
        network: The former.
        refinement: The latter.

    Raises:
        BadInputError: The file is not such a network.
    """

    def __init__(self, weights: Path) -> None:
        self.network, self.refinement = Network(weights), RefinementNetwork()
        self._scale = self._read_scale()
        missing = OUTPUTS.keys() - set(self.network.outputs)
        if missing or self.network.channels not in {1, 3} or not 0 < self._scale <= 1:
            raise BadInputError(
                f"{weights}: not a single-frame network; it takes 1 or 3 channels and gives "
                f"{', '.join(OUTPUTS)}"
            )

    def _read_scale(self) -> float:
        """0, which no network has, where what is stated is no number."""
        try:
            return float(self.network.metadata.get("scale", 1))
        except ValueError:
            return 0.0

    def estimate(self, image: GreyImage) -> Estimate:
        """Estimates displacement and scores in one image, (H, W)."""
        return combine_estimates(
            self.network_maps(image), RefinedMeasurement.of_image(image, self.refinement)
        )

    def network_maps(self, image: GreyImage) -> Maps:
        """The network's outputs at the image's own size and in its own px.

        `own` is the certainty, 1 / px^2, that is due to the image.
        """
        height, width = image.shape
        seen = image
        if self._scale < 1:
            size = [max(round(side * self._scale), 1) for side in (width, height)]
            seen = np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA))
        grey = seen.astype(np.float32) / np.float32(WHITE)
        planes = np.broadcast_to(grey, (self.network.channels, *grey.shape))
        maps = {
            name: np.asarray(cv2.resize(map_.transpose(1, 2, 0), (width, height)))
            if self._scale < 1
            else np.squeeze(map_.transpose(1, 2, 0))
            for name, map_ in self.network(planes).items()
        }
        own = np.maximum(np.exp(-maps["log_variance"]) - np.float32(PRIOR_CERTAINTY), 0)
        maps["own"] = own * np.float32(self._scale**2)
        maps["displacement"] = maps["displacement"] / np.float32(self._scale)
        maps["log_variance"] = maps["log_variance"] - np.float32(2 * np.log(self._scale))
        return maps


def enlarge_mask(mask: BoolArray, shape: tuple[int, ...]) -> BoolArray:
    """(H, W) of a mask at half resolution, rounded up."""
    return mask.repeat(2, axis=0).repeat(2, axis=1)[: shape[0], : shape[1]]


def combine_estimates(network: Maps, measurement: RefinedMeasurement) -> Estimate:
    """The network's estimate, and the refined measurement where there is one.

    Displacements are weighted by their inverse variances, in which the prior that both networks
    share counts once; on lattices the refined one alone counts.

    Args:
        network: (H, W, 2) `displacement` px, (H, W) `log_variance` of either component, log px^2,
            `own` 1 / px^2, and `logit`.
        measurement: Of the same image.
    """
    certain: Any = np.exp(-network["log_variance"])
    more: Any = 0
    displacement, refined_logit = network["displacement"], np.zeros_like(network["logit"])
    if measurement.refined is not None:
        certain = np.where(measurement.texture == Texture.STRAIGHT, network["own"], certain)
        certain[measurement.texture == Texture.LATTICE] = 0
        where = np.isin(measurement.texture, MEASURABLE)
        more = np.where(where, np.exp(-measurement.refined["log_variance"]), 0)
        refined_logit = np.where(where, measurement.refined["logit"], 0)
        share = np.asarray(more / (certain + more), dtype=np.float32)
        step = measurement.refined["displacement"] - displacement
        displacement = displacement + step * cv2.merge([share, share])
    return Estimate(
        displacement=displacement,
        sigma_px=np.asarray(1 / np.sqrt(certain + more), dtype=np.float32),
        texture=measurement.texture,
        scores=cv2.merge([network["logit"], refined_logit]),
    )
