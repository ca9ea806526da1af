"""The detector that takes one frame alone."""

from pathlib import Path

import numpy as np

from detect.calibration import Calibration
from detect.detection import Detection, Frames
from detect.dybs.eye import Look, Reading, SingleFrame, joined
from detect.response import Response
from detect.texture import Classes, Texture
from geometry.arrays import BoolArray
from geometry.errors import BadInputError

SCORES = ("logit", "judge")
CLASS_NAMES = tuple(texture.name.lower() for texture in Texture)


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
            return Detection.silent(image.shape)
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
