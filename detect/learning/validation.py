"""How well a network does on samples it does not train on."""

from collections.abc import Callable
from dataclasses import asdict, dataclass

import numpy as np

from detect.learning.config import TrainConfig
from detect.learning.pools import SamplePool, as_input
from detect.scores import auroc

Predict = Callable[[np.ndarray], dict[str, np.ndarray]]
BATCH = 16
PIXEL_STRIDE = 7


@dataclass(frozen=True, kw_only=True)
class ValidationScore:
    """Of the samples of one family.

    Attributes:
        auroc: Of the mask's logit (of the size, without one); pixels between the two thresholds
            are left out, and only every `PIXEL_STRIDE`-th pixel is scored.
        epe_px: Mean length of the displacement's error where there is plume.
        zero_epe_px: The same for an answer of zero.
        explained: 1 - mean squared error / mean square, over all pixels.
    """

    auroc: float
    epe_px: float
    zero_epe_px: float
    explained: float

    def to_plain(self) -> dict[str, float]:
        """Four digits of each."""
        return {name: round(float(value), 4) for name, value in asdict(self).items()}


def validate_network(
    predict: Predict, pool: SamplePool, config: TrainConfig
) -> dict[str, ValidationScore]:
    """Scores by family, on samples spread evenly over the pool."""
    chosen = np.unique(np.linspace(0, len(pool) - 1, config.validation_samples).astype(int))
    columns: dict[int, list[np.ndarray]] = {}
    for start in range(0, len(chosen), BATCH):
        some = chosen[start : start + BATCH]
        prediction = predict(as_input(pool.images[some]))
        truth = np.moveaxis(pool.displacements[some], -1, 1).astype(np.float32)
        limits_px = pool.limits_px(some, config)
        for k, family in enumerate(pool.families[some]):
            one = {name: map_[k] for name, map_ in prediction.items()}
            columns.setdefault(int(family), []).append(_thin_pixels(one, truth[k], limits_px[k]))
    return {
        pool.family_names[family]: _score_family(np.concatenate(parts, axis=1))
        for family, parts in sorted(columns.items())
    }


def _thin_pixels(
    prediction: dict[str, np.ndarray], truth: np.ndarray, limits_px: np.ndarray
) -> np.ndarray:
    """(5, N): score, size of the truth and of the error, plume, none, for some of the pixels."""
    answer = prediction["displacement"]
    score = prediction["logit"][0] if "logit" in prediction else np.linalg.norm(answer, axis=0)
    size, error = (np.linalg.norm(vectors, axis=0) for vectors in (truth, answer - truth))
    maps = [score, size, error, size > limits_px[0], size < limits_px[1]]
    return np.stack(maps).reshape(len(maps), -1)[:, ::PIXEL_STRIDE]


def _score_family(columns: np.ndarray) -> ValidationScore:
    score, size, error = columns[:3]
    plume, none = columns[3:].astype(bool)
    asked = plume | none
    return ValidationScore(
        auroc=auroc(score[asked], plume[asked]),
        epe_px=float(error[plume].mean()) if plume.any() else float("nan"),
        zero_epe_px=float(size[plume].mean()) if plume.any() else float("nan"),
        explained=float(1 - (error**2).mean() / max((size**2).mean(), 1e-12)),
    )
