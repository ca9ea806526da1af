"""What networks, waves and straight edges say of an image, before anything is believed."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

import cv2
import numpy as np

from detect.dybs.judge import Judge
from detect.dybs.measure import Measured, measure
from detect.dybs.sound import heard
from detect.network import Maps, Network
from detect.texture import Classes, Texture, texture_classes
from geometry.arrays import BoolArray, FloatMap, GreyImage
from geometry.errors import BadInputError

WHITE = 255.0
OUTPUTS = {"displacement": 2, "log_variance": 1, "logit": 1}
MEASURABLE = (Texture.LATTICE, Texture.STRAIGHT)
UNSEEING = 1500.0
"""Certainty, 1 / px^2, of a network that sees nothing: it knows how large plumes mostly are, and so
does the judge. Chosen on validation samples; px of the network's own image."""


@dataclass(frozen=True, kw_only=True)
class Look:
    """What the networks say of an image.

    Attributes:
        displacement: (H, W, 2) px of both, weighted by their inverse variances.
        sigma_px: (H, W) of either component.
        texture: (H, W) of `Texture`.
        scores: (H, W, 2), the network's logit and the judge's: higher means refraction.
    """

    displacement: FloatMap
    sigma_px: FloatMap
    texture: Classes
    scores: FloatMap


@dataclass(frozen=True, kw_only=True)
class Reading:
    """What waves and straight edges say of an image, as a judge reads them.

    Attributes:
        texture: (H, W) of `Texture`; a lattice whose waves say nothing counts as straight, and
            straight edges that are not to be believed as irregular.
        measured: Waves and edges.
        says: Displacement, log-variance and logit at full size; None where there is neither.
    """

    texture: Classes
    measured: Measured
    says: Maps | None

    @classmethod
    def of(cls, image: GreyImage, judge: Judge) -> Self:
        """Reads an image, (H, W)."""
        texture = texture_classes(image)
        measured = measure(image, texture)
        waves = enlarged(measured.lattice, image.shape)
        texture[(texture == Texture.LATTICE) & ~waves] = Texture.STRAIGHT
        straight = texture == Texture.STRAIGHT
        if straight.any():
            counts = heard(straight[::2, ::2], measured.sound, measured.lattice)
            texture[straight & ~enlarged(counts, image.shape)] = Texture.IRREGULAR
        says = judge(measured, image.shape) if np.isin(texture, MEASURABLE).any() else None
        return cls(texture=texture, measured=measured, says=says)


class SingleFrame:
    """A network that looks at the image, joined by one that judges its waves and straight edges.

    Args:
        weights: The .onnx file of the former. Its metadata may hold `scale`: how much smaller an
            image it wants.

    Attributes:
        network: The former.
        judge: The latter.

    Raises:
        BadInputError: The file is not such a network.
    """

    def __init__(self, weights: Path) -> None:
        self.network, self.judge = Network(weights), Judge()
        self._scale = float(self.network.metadata.get("scale", 1))
        missing = OUTPUTS.keys() - set(self.network.outputs)
        if missing or self.network.channels not in {1, 3} or not 0 < self._scale <= 1:
            raise BadInputError(
                f"{weights}: not a single-frame network; it takes 1 or 3 channels and gives "
                f"{', '.join(OUTPUTS)}"
            )

    def look(self, image: GreyImage) -> Look:
        """Looks at one image, (H, W)."""
        return joined(self.maps(image), Reading.of(image, self.judge))

    def maps(self, image: GreyImage) -> Maps:
        """The network's, at the image's own size and in its own px; see `Judge`.

        `own` is the certainty, 1 / px^2, that it owes to the image.
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
        own = np.maximum(np.exp(-maps["log_variance"]) - np.float32(UNSEEING), 0)
        maps["own"] = own * np.float32(self._scale**2)
        maps["displacement"] = maps["displacement"] / np.float32(self._scale)
        maps["log_variance"] = maps["log_variance"] - np.float32(2 * np.log(self._scale))
        return maps


def enlarged(mask: BoolArray, shape: tuple[int, ...]) -> BoolArray:
    """(H, W) of a mask at half resolution, rounded up."""
    return mask.repeat(2, axis=0).repeat(2, axis=1)[: shape[0], : shape[1]]


def joined(seen: Maps, reading: Reading) -> Look:
    """What a network saw, and what was read where there is something to read.

    Displacements are weighted by their inverse variances, to which what both know of any plume
    counts once; on lattices the judge's alone counts.

    Args:
        seen: (H, W, 2) `displacement` px, (H, W) `log_variance` of either component, log px^2,
            `own` 1 / px^2, and `logit`.
        reading: Of the same image.
    """
    certain: Any = np.exp(-seen["log_variance"])
    more: Any = 0
    displacement, judged = seen["displacement"], np.zeros_like(seen["logit"])
    if reading.says is not None:
        certain = np.where(reading.texture == Texture.STRAIGHT, seen["own"], certain)
        certain[reading.texture == Texture.LATTICE] = 0
        where = np.isin(reading.texture, MEASURABLE)
        more = np.where(where, np.exp(-reading.says["log_variance"]), 0)
        judged = np.where(where, reading.says["logit"], 0)
        share = np.asarray(more / (certain + more), dtype=np.float32)
        step = reading.says["displacement"] - displacement
        displacement = displacement + step * cv2.merge([share, share])
    return Look(
        displacement=displacement,
        sigma_px=np.asarray(1 / np.sqrt(certain + more), dtype=np.float32),
        texture=reading.texture,
        scores=cv2.merge([seen["logit"], judged]),
    )
