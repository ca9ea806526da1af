"""A small network that refines what waves and straight edges measure."""

from pathlib import Path

import cv2
import numpy as np
from scipy.special import expit

from detect.dybs.pattern_measurement import CHANNELS, PatternMeasurement, network_channels
from detect.network import Maps, Network
from geometry.arrays import FloatMap
from geometry.errors import BadInputError

WEIGHTS = Path(__file__).parent / "weights" / "judge.onnx"
OUTPUTS = {"displacement", "log_variance", "logit"}
WAVES_AGAIN = 0.1
"""Weight of the waves' own information beside the network, which has used it once and shrinks what
no plume of its training did; chosen on validation samples."""
UNSURE, SURE, FROM_LOGIT = 0.5, 1.3, -2.0
"""Factors far below and above a logit: the network's displacement is too long where a plume is
unlikely, and too short where it is likely; chosen on validation samples."""


class RefinementNetwork:
    """Refines a measurement by how plumes are shaped.

    It fills in the direction that a single wave lacks, averages noise out, and separates bent walls
    and rough edges from plumes.

    Args:
        weights: The .onnx file.

    Raises:
        BadInputError: The file is not such a network.
    """

    def __init__(self, weights: Path = WEIGHTS) -> None:
        self.network = Network(weights)
        if self.network.channels != CHANNELS or OUTPUTS - set(self.network.outputs):
            raise BadInputError(
                f"{weights}: not a refinement network, which takes {CHANNELS} channels"
            )

    def __call__(self, measured: PatternMeasurement, shape: tuple[int, ...]) -> Maps:
        """`displacement` px (H, W, 2), `log_variance` and `logit` (H, W) of an image of `shape`."""
        height, width = shape
        output = self.network(network_channels(measured))
        plume = expit(output["logit"] - np.float32(FROM_LOGIT))
        stretched = output["displacement"] * np.float32(UNSURE + (SURE - UNSURE) * plume)
        displacement, log_variance = _combine_with_waves(
            stretched.transpose(1, 2, 0), output["log_variance"][0], measured
        )
        maps = {
            "displacement": displacement,
            "log_variance": log_variance,
            "logit": output["logit"][0],
        }
        size = (2 * log_variance.shape[1], 2 * log_variance.shape[0])
        return {
            name: np.asarray(cv2.resize(map_, size))[:height, :width] for name, map_ in maps.items()
        }


def _combine_with_waves(
    displacement: FloatMap, log_variance: FloatMap, measured: PatternMeasurement
) -> tuple[FloatMap, FloatMap]:
    """The network's displacement and the waves' own, weighted by inverse covariance.

    Args:
        displacement: (h, w, 2) px.
        log_variance: (h, w) of either component, log px^2.
        measured: Of the same image.

    Returns:
        (h, w, 2) px; (h, w) log-variance.
    """
    certain = np.exp(-log_variance)
    information = WAVES_AGAIN * measured.information * measured.lattice[..., None]
    xx, xy, yy = np.moveaxis(information, -1, 0)
    more = measured.displacement - displacement
    right, down = xx * more[..., 0] + xy * more[..., 1], xy * more[..., 0] + yy * more[..., 1]
    xx, yy = xx + certain, yy + certain
    determinant = xx * yy - xy * xy
    step = np.stack([yy * right - xy * down, xx * down - xy * right], axis=-1)
    best = displacement + step / determinant[..., None]
    variance = (xx + yy) / (2 * determinant)
    return best.astype(np.float32), np.log(variance).astype(np.float32)
