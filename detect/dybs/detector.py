"""The detector that takes one frame alone."""

from pathlib import Path

import numpy as np

from detect.calibration import Calibration
from detect.detection import Detection, Frames
from detect.dybs.estimator import (
    Estimate,
    RefinedMeasurement,
    SingleFrameEstimator,
    combine_estimates,
)
from detect.response import Response
from detect.texture import Classes, Texture
from geometry.arrays import BoolArray
from geometry.errors import BadInputError

SCORES = ("logit", "judge")
"""As the calibration in the files names them: of the network, and of the refinement."""
CLASS_NAMES = tuple(texture.name.lower() for texture in Texture)


class DybsDetector:
    """Refraction by how the background is distorted: no neighbours, no reference.

    The paper's idea (DYBS), and what physics leaves of it: it works on lattices, somewhat on
    straight edges, and elsewhere has no evidence (llr 0, sigma inf). The calibration in the
    network's file states which. An int8 twin replaces a network where masks at speed matter.

    Args:
        weights: The .onnx file of a calibrated network.

    Attributes:
        estimator: Of displacement and scores.
        calibration: From scores to evidence.

    Raises:
        BadInputError: The file is not such a network.
    """

    name = "dybs"
    response: Response | None = None
    uses_other_frames = False

    def __init__(self, weights: str | Path) -> None:
        self.estimator = SingleFrameEstimator(Path(weights))
        self.calibration = Calibration.from_plain(
            self.estimator.network.read_metadata("calibration"), str(weights)
        )
        if self.calibration.scores != SCORES:
            raise BadInputError(f"{weights}: calibrated for other scores; calibrate it anew")

    def detect(self, frames: Frames, index: int) -> Detection:
        """Measures frame `index` by itself; the network runs where a class may have evidence."""
        image = frames.images[index]
        measurement = RefinedMeasurement.of_image(image, self.estimator.refinement)
        if not self._has_evidence(measurement.texture).any():
            return Detection.without_evidence(image.shape)
        return self.to_detection(combine_estimates(self.estimator.network_maps(image), measurement))

    def to_detection(self, estimate: Estimate) -> Detection:
        """Turns scores into evidence; none in classes that are not calibrated."""
        has_evidence = self._has_evidence(estimate.texture)
        displacement = estimate.displacement.copy()
        displacement[~has_evidence] = 0
        return Detection(
            displacement=displacement,
            sigma_px=np.where(has_evidence, estimate.sigma_px, np.float32(np.inf)),
            llr=self.calibration.llr(estimate.scores, estimate.texture, CLASS_NAMES),
        )

    def _has_evidence(self, texture: Classes) -> BoolArray:
        """(H, W) where the calibration knows the class."""
        return np.isin(texture, [CLASS_NAMES.index(name) for name in self.calibration.scales])
