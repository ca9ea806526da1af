"""The detector that takes one frame alone."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

import cv2
import numpy as np

from detect.calibration import Calibration
from detect.detection import Detection, Frames
from detect.dybs.judge import Judge
from detect.dybs.measure import Measured, measure
from detect.network import Maps, Network
from detect.response import Response
from detect.texture import Classes, Texture, texture_classes
from geometry.arrays import BoolArray, FloatMap, GreyImage
from geometry.errors import BadInputError

WHITE = 255.0
SCORES = ("logit", "judge")
CLASS_NAMES = tuple(texture.name.lower() for texture in Texture)
OUTPUTS = {"displacement": 2, "log_variance": 1, "logit": 1}
MEASURABLE = (Texture.LATTICE, Texture.STRAIGHT)


@dataclass(frozen=True, kw_only=True)
class Look:
    """What the networks say of an image, before anything is believed.

    Attributes:
        displacement: (H, W, 2) px of both, weighted by their inverse variances.
        sigma_px: (H, W) of either component.
        texture: (H, W) of `Texture`.
        scores: (H, W, 2), `SCORES`: higher means refraction.
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
        waves, sound = (
            map_.repeat(2, axis=0).repeat(2, axis=1)[: image.shape[0], : image.shape[1]]
            for map_ in (measured.lattice, measured.sound)
        )
        texture[(texture == Texture.LATTICE) & ~waves] = Texture.STRAIGHT
        texture[(texture == Texture.STRAIGHT) & ~sound] = Texture.IRREGULAR
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
        """The network's, at the image's own size and in its own px; see `Judge`."""
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
    response: Response | None = None

    def __init__(self, weights: Path) -> None:
        self.eye = SingleFrame(weights)
        self.calibration = Calibration.from_plain(
            self.eye.network.json("calibration"), str(weights)
        )
        if self.calibration.scores != SCORES:
            raise BadInputError(f"{weights}: calibrated for other scores; calibrate it anew")

    def detect(self, frames: Frames, index: int) -> Detection:
        """Measures frame `index` by itself; the network is asked where a class may speak."""
        image = frames.images[index]
        reading = Reading.of(image, self.eye.judge)
        if not self._heard(reading.texture).any():
            return silence(image.shape)
        return self.judge(joined(self.eye.maps(image), reading))

    def judge(self, look: Look) -> Detection:
        """Turns scores into evidence, and silences the classes that say nothing."""
        heard = self._heard(look.texture)
        displacement = look.displacement.copy()
        displacement[~heard] = 0
        return Detection(
            displacement=displacement,
            sigma_px=np.where(heard, look.sigma_px, np.float32(np.inf)),
            llr=self.calibration.llr(look.scores, look.texture, CLASS_NAMES),
        )

    def _heard(self, texture: Classes) -> BoolArray:
        """(H, W) where the calibration knows the class."""
        return np.isin(texture, [CLASS_NAMES.index(name) for name in self.calibration.scales])


def silence(shape: tuple[int, ...]) -> Detection:
    """Of an image, (H, W), that has nothing to say anywhere."""
    return Detection(
        displacement=np.zeros((*shape, 2), np.float32),
        sigma_px=np.full(shape, np.inf, np.float32),
        llr=np.zeros(shape, np.float32),
    )


def joined(seen: Maps, reading: Reading) -> Look:
    """What a network saw, and what was read where there is something to read.

    Displacements are weighted by their inverse variances; on lattices the judge's alone counts.

    Args:
        seen: (H, W, 2) `displacement` px, (H, W) `log_variance` of either component, log px^2, and
            `logit`.
        reading: Of the same image.
    """
    certain: Any = np.exp(-seen["log_variance"])
    more: Any = 0
    displacement, judged = seen["displacement"], np.zeros_like(seen["logit"])
    if reading.says is not None:
        certain = np.where(reading.texture == Texture.LATTICE, 0, certain)
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
