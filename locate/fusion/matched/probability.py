"""How likely a column is a plume, by what its turn and its pixels say together."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import expit

from geometry.arrays import BoolArray, FloatArray

OFFSET, PER_SIGMA, PER_LOG_NAT, INWARD = -9.0, 1.2, 0.55, -1.4
"""Of the logistic curve (docs/weak_plumes.md): by the sigmas of the turn, by the logarithm of 1 and
the nats of the pixels a view, and for gases that bend light towards the axis. The last is chosen by
hand: they are taken to be a quarter as frequent."""
LEAST_PROBABILITY = 0.8
"""What a plume needs to be reported."""


def true_probability(sigmas: ArrayLike, nats_per_view: ArrayLike) -> FloatArray:
    """(...) that a column is a plume.

    Args:
        sigmas: (...) of the turn of the displacement about its axis, negative where light is bent
            towards it.
        nats_per_view: (...) evidence of its pixels for a plume.
    """
    turn = PER_SIGMA * np.abs(sigmas) + INWARD * (np.asarray(sigmas) < 0)
    pixels = PER_LOG_NAT * np.log1p(np.maximum(nats_per_view, 0))
    return np.asarray(expit(OFFSET + turn + pixels))


def passes(sigmas: ArrayLike, nats_per_view: ArrayLike) -> BoolArray:
    """(...) whether such a column is reported as a plume."""
    return np.asarray(true_probability(sigmas, nats_per_view) >= LEAST_PROBABILITY)


@dataclass(frozen=True, kw_only=True)
class ColumnStrength:
    """What a column shows.

    Attributes:
        sigmas: Of the turn about its axis, negative where light is bent towards it.
        nats_per_view: Evidence of its pixels.
    """

    sigmas: float
    nats_per_view: float

    @property
    def probability(self) -> float:
        """That it is a plume."""
        return float(true_probability(self.sigmas, self.nats_per_view))
