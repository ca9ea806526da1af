"""A small network that reads what waves and straight edges measure."""

from pathlib import Path

import cv2
import numpy as np
from scipy.special import expit

from detect.dybs.measure import CHANNELS, Measured, channels
from detect.network import Maps, Network
from geometry.arrays import FloatMap
from geometry.errors import BadInputError

WEIGHTS = Path(__file__).parent / "weights" / "judge.onnx"
OUTPUTS = {"displacement", "log_variance", "logit"}
WAVES_AGAIN = 0.1
"""What waves count for beside a judge that has seen them, and shrinks what it never saw a plume do;
chosen on validation samples."""
UNSURE, SURE, FROM_LOGIT = 0.5, 1.3, -2.0
"""What the judge says is too long where it hardly believes in a plume, and too short where it does:
factors far below and above a logit; chosen on validation samples."""


class Judge:
    """Knows how plumes look, and so what to make of a measurement.

    It fills in the direction that a single wave lacks, looks through noise, and tells a bent wall
    or a rough edge from a plume.

    Args:
        weights: The .onnx file.

    Raises:
        BadInputError: The file is not such a network.
    """

    def __init__(self, weights: Path = WEIGHTS) -> None:
        self.network = Network(weights)
        if self.network.channels != CHANNELS or OUTPUTS - set(self.network.outputs):
            raise BadInputError(f"{weights}: not a judge, which reads {CHANNELS} channels")

    def __call__(self, measured: Measured, shape: tuple[int, ...]) -> Maps:
        """`displacement` px (H, W, 2), `log_variance` and `logit` (H, W) of an image of `shape`."""
        height, width = shape
        says = self.network(channels(measured))
        belief = expit(says["logit"] - np.float32(FROM_LOGIT))
        stretched = says["displacement"] * np.float32(UNSURE + (SURE - UNSURE) * belief)
        displacement, log_variance = _with_waves(
            stretched.transpose(1, 2, 0), says["log_variance"][0], measured
        )
        maps = {
            "displacement": displacement,
            "log_variance": log_variance,
            "logit": says["logit"][0],
        }
        size = (2 * log_variance.shape[1], 2 * log_variance.shape[0])
        return {
            name: np.asarray(cv2.resize(map_, size))[:height, :width] for name, map_ in maps.items()
        }


def _with_waves(
    displacement: FloatMap, log_variance: FloatMap, measured: Measured
) -> tuple[FloatMap, FloatMap]:
    """The judge's displacement and the waves' own, weighted by inverse covariance.

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
