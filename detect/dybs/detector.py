"""The detector that takes one frame alone."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from detect.calibration import Calibration
from detect.detection import Detection, Frames
from detect.dybs.demodulation import Demodulation, demodulate
from detect.network import Network
from detect.texture import Classes, Texture, texture_classes
from detect.warp import blur
from geometry.arrays import FloatMap, GreyImage
from geometry.errors import BadInputError

WHITE = 255.0
SCORES = ("logit", "waves")
CLASS_NAMES = tuple(texture.name.lower() for texture in Texture)
OUTPUTS = {"displacement": 2, "log_variance": 1, "logit": 1}
POOL_PX = 5.0
WAVES_FLOOR = 0.3
"""Keeps the logarithm of still air finite."""


@dataclass(frozen=True, kw_only=True)
class Look:
    """What a network and the waves say of an image, before anything is believed.

    Attributes:
        displacement: (H, W, 2) px of both, weighted by their inverse covariances.
        sigma_px: (H, W) of either component.
        texture: (H, W) of `Texture`.
        scores: (H, W, 2), `SCORES`: higher means refraction.
    """

    displacement: FloatMap
    sigma_px: FloatMap
    texture: Classes
    scores: FloatMap


class SingleFrame:
    """A network of displacement, log-variance and logit, joined by demodulation on lattices.

    Args:
        weights: The .onnx file. Its metadata may hold `scale`: how much smaller an image it wants.

    Raises:
        BadInputError: The file is not such a network.
    """

    def __init__(self, weights: Path) -> None:
        self.network = Network(weights)
        self._scale = float(self.network.metadata.get("scale", 1))
        missing = OUTPUTS.keys() - set(self.network.outputs)
        if missing or self.network.channels not in {1, 3} or not 0 < self._scale <= 1:
            raise BadInputError(
                f"{weights}: not a single-frame network; it takes 1 or 3 channels and gives "
                f"{', '.join(OUTPUTS)}"
            )

    def look(self, image: GreyImage) -> Look:
        """Looks at one image, (H, W)."""
        maps = self._maps(image)
        texture = texture_classes(image)
        waves = demodulate(image, texture == Texture.LATTICE)
        certain = waves.information[..., 0] + waves.information[..., 2]
        texture[(texture == Texture.LATTICE) & (certain <= 0)] = Texture.STRAIGHT
        displacement, sigma_px = joined(maps["displacement"], maps["log_variance"], waves)
        return Look(
            displacement=displacement,
            sigma_px=sigma_px,
            texture=texture,
            scores=np.stack([maps["logit"], waves_score(waves)], axis=-1),
        )

    def _maps(self, image: GreyImage) -> dict[str, FloatMap]:
        """The network's, at the image's own size and in its own px."""
        height, width = image.shape
        seen = image
        if self._scale < 1:
            size = [max(round(side * self._scale), 1) for side in (width, height)]
            seen = np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA))
        planes = np.repeat(seen[None].astype(np.float32) / WHITE, self.network.channels, axis=0)
        maps = {
            name: np.asarray(cv2.resize(map_.transpose(1, 2, 0), (width, height)))
            if self._scale < 1
            else np.squeeze(map_.transpose(1, 2, 0))
            for name, map_ in self.network(planes).items()
        }
        maps["displacement"] = maps["displacement"] / np.float32(self._scale)
        maps["log_variance"] = maps["log_variance"] - np.float32(2 * np.log(self._scale))
        return maps


class DybsDetector:
    """Refraction by the distorted look of the background: no neighbours, no reference.

    The paper's idea (DYBS), and what physics leaves of it: on lattices it works, on straight edges
    somewhat, elsewhere it keeps silent (llr 0, sigma inf). Which is which, the calibration in the
    network's file says. The int8 twin of a network takes its place where masks at speed matter.

    Args:
        weights: The .onnx file of a calibrated network.

    Attributes:
        eye: Looks.
        calibration: Judges what was seen.

    Raises:
        BadInputError: The file is not such a network.
    """

    name = "dybs"

    def __init__(self, weights: Path) -> None:
        self.eye = SingleFrame(weights)
        self.calibration = Calibration.from_plain(
            self.eye.network.json("calibration"), str(weights)
        )
        if self.calibration.scores != SCORES:
            raise BadInputError(f"{weights}: calibrated for other scores; calibrate it anew")

    def detect(self, frames: Frames, index: int) -> Detection:
        """Measures frame `index` by itself."""
        return self.judge(self.eye.look(frames.images[index]))

    def judge(self, look: Look) -> Detection:
        """Turns scores into evidence, and silences the classes that say nothing."""
        llr = self.calibration.llr(look.scores, look.texture, CLASS_NAMES)
        heard = [CLASS_NAMES.index(name) for name in self.calibration.scales]
        silent = ~np.isin(look.texture, heard)
        return Detection(
            displacement=np.where(silent[..., None], np.float32(0), look.displacement),
            sigma_px=np.where(silent, np.float32(np.inf), look.sigma_px),
            llr=llr,
        )


def waves_score(waves: Demodulation) -> FloatMap:
    """(H, W) log of the size that waves measure in their own sigmas, pooled; 0 without waves."""
    certain = waves.information[..., 0] + waves.information[..., 2]
    if not certain.any():
        return certain
    size_px = np.hypot(waves.displacement[..., 0], waves.displacement[..., 1])
    score = np.log(blur(size_px, POOL_PX) * np.sqrt(certain) + WAVES_FLOOR)
    score[certain <= 0] = 0
    return np.asarray(score, dtype=np.float32)


def joined(
    displacement: FloatMap, log_variance: FloatMap, waves: Demodulation
) -> tuple[FloatMap, FloatMap]:
    """A network's displacement and the waves', each weighted by its inverse covariance.

    Args:
        displacement: (H, W, 2) px.
        log_variance: (H, W) of either component, log px^2.
        waves: Of the same image.

    Returns:
        (H, W, 2) px; (H, W) sigma_px of either component.
    """
    if not waves.information.any():
        return displacement, np.exp(log_variance / 2)
    certain: Any = np.exp(-log_variance)
    x, y = np.moveaxis(waves.displacement, -1, 0)
    xx, xy, yy = np.moveaxis(waves.information, -1, 0)
    right = certain * displacement[..., 0] + xx * x + xy * y
    down = certain * displacement[..., 1] + xy * x + yy * y
    xx, yy = xx + certain, yy + certain
    determinant = xx * yy - xy * xy
    best = np.stack([yy * right - xy * down, xx * down - xy * right], axis=-1)
    sigma_px = np.sqrt((xx + yy) / (2 * determinant))
    return (best / determinant[..., None]).astype(np.float32), sigma_px.astype(np.float32)
